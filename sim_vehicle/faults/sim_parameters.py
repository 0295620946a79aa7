"""ArduPilot's simulation parameters that cause failures, and the faults for their values.

SIM_BATT_VOLTAGE, SIM_RC_FAIL and the wind are not faults, but flight parameters of the personality.
"""

import math
from collections.abc import Callable, Sequence

from sim_vehicle.faults.spec import FaultSpec

Read = Callable[[str], float]  # name of a parameter -> present value
METRES_PER_DEGREE = 111_319.5
MAX_OFFSET_M = 1e6  # limit of gps_glitch
N_MOTORS = 4


def _gps(read: Read, _lat_deg: float) -> list[FaultSpec]:
    return [FaultSpec(fault="gps_loss")] if read("SIM_GPS_DISABLE") else []


def _glitch(read: Read, lat_deg: float) -> list[FaultSpec]:
    """Return the GPS glitch: X [degrees of latitude], Y [degrees of longitude], Z [m]."""
    offsets = {
        "north_m": read("SIM_GPS_GLITCH_X") * METRES_PER_DEGREE,
        "east_m": read("SIM_GPS_GLITCH_Y") * METRES_PER_DEGREE * math.cos(math.radians(lat_deg)),
        "up_m": read("SIM_GPS_GLITCH_Z"),
    }
    if not any(offsets.values()):
        return []
    params = {name: min(max(offset, -MAX_OFFSET_M), MAX_OFFSET_M) for name, offset in offsets.items()}
    return [FaultSpec(fault="gps_glitch", params=params)]


def _engine(read: Read, _lat_deg: float) -> list[FaultSpec]:
    """Return the loss of the motors in a mask; a thrust above one half is no loss."""
    mask = read("SIM_ENGINE_FAIL")
    if not math.isfinite(mask) or read("SIM_ENGINE_MUL") > 0.5:
        return []
    motors = (int(mask) & (2**N_MOTORS - 1)).bit_count()
    return [FaultSpec(fault="motor_loss", params={"motors": motors})] if motors else []


_GROUPS: dict[str, Callable[[Read, float], list[FaultSpec]]] = {
    "SIM_GPS_DISABLE": _gps,
    "SIM_GPS_GLITCH_X": _glitch,
    "SIM_GPS_GLITCH_Y": _glitch,
    "SIM_GPS_GLITCH_Z": _glitch,
    "SIM_ENGINE_FAIL": _engine,
    "SIM_ENGINE_MUL": _engine,
}


def faults_of(name: str, read: Read, lat_deg: float) -> tuple[str, Sequence[FaultSpec]] | None:
    """Return a key and the faults for a changed parameter, or None if the parameter never causes a fault.

    lat_deg: latitude of the vehicle.
    Parameters of one fault have the same key, see `Schedule.replace`.
    """
    faults = _GROUPS.get(name)
    return None if faults is None else (faults.__name__, faults(read, lat_deg))
