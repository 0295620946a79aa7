"""A live table of the fleet for a terminal."""

from rich.table import Table

from sim_vehicle.fleet import Fleet


def fleet_table(fleet: Fleet, simulated_s: float, speedup: float) -> Table:
    """One row a vehicle, from the truth."""
    table = Table(title=f"sim_vehicle  {simulated_s:.0f} s flown at {speedup:g}x")
    for heading in ("sysid", "mode", "armed", "height [m]", "speed [m/s]", "battery", "strikes", "place"):
        table.add_column(heading, justify="right")
    truth = fleet.positions()
    for i, sysid in enumerate(truth.sysid.tolist()):
        table.add_row(
            str(sysid),
            truth.mode[i],
            "yes" if truth.armed[i] else "no",
            f"{truth.height_m[i]:.1f}",
            f"{truth.speed_m_s[i]:.1f}",
            f"{truth.battery_remaining[i]:.0%}",
            str(truth.strikes[i]),
            f"{truth.lat_deg[i]:.6f}, {truth.lon_deg[i]:.6f}",
        )
    return table
