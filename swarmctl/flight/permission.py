"""The permission to arm vehicles that the built-in simulator does not fly."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from swarmctl.flight.own_vehicle import OwnVehicle, not_simulated


class PreflightFailed(Exception):
    """A failed preflight; one line for each reason."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = tuple(lines)


Permission = Callable[[Sequence[OwnVehicle]], None]
"""a function called with the vehicles that are not simulated; raises PreflightFailed to forbid arming"""


def vehicles_to_permit(vehicles: Sequence[OwnVehicle]) -> list[OwnVehicle]:
    """Return the vehicles that the built-in simulator does not fly.

    Raises PreflightFailed if two vehicles share a system id, or if another vehicle answers in place of a
    simulated vehicle.
    """
    duplicates = [m for m in vehicles if m.runner.sysid_conflict]
    if duplicates:
        advice = "give each vehicle its own system id"
        raise PreflightFailed([f"{m.name}: {m.runner.sysid_conflict}; {advice}" for m in duplicates])
    external = not_simulated(vehicles)
    unexpected = [m for m in external if m.spec.simulated]
    if unexpected:
        raise PreflightFailed([_unexpected(m) for m in unexpected])
    return external


def _unexpected(vehicle: OwnVehicle) -> str:
    found = vehicle.identity.firmware if vehicle.identity is not None else "an unknown autopilot"
    return (
        f"{vehicle.name}: found {found} at {vehicle.spec.url}, system id {vehicle.spec.sysid}, expected a "
        "vehicle of the built-in simulator; stop the autopilot that sends to this port, or list it under "
        "`vehicles` and fly with --real [not-simulated]"
    )
