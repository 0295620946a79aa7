"""MAV_CMD_INJECT_FAILURE: the fault for each unit and type of failure."""

from collections.abc import Callable, Hashable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.spec import FaultSpec

# Function of (key, faults, now): ends the faults under the key and begins the given faults.
Replace = Callable[[Hashable, Sequence[FaultSpec], float], None]

ACCEPTED = int(mavlink.MAV_RESULT_ACCEPTED)
UNSUPPORTED = int(mavlink.MAV_RESULT_UNSUPPORTED)
OFF = int(mavlink.FAILURE_TYPE_OFF)
STUCK = int(mavlink.FAILURE_TYPE_STUCK)
GARBAGE = int(mavlink.FAILURE_TYPE_GARBAGE)
WRONG = int(mavlink.FAILURE_TYPE_WRONG)
SLOW = int(mavlink.FAILURE_TYPE_SLOW)
DELAYED = int(mavlink.FAILURE_TYPE_DELAYED)
INTERMITTENT = int(mavlink.FAILURE_TYPE_INTERMITTENT)
MOTOR = int(mavlink.FAILURE_UNIT_SYSTEM_MOTOR)
N_MOTORS = 4
EMPTY_CHARGE = 0.04  # share of the full charge: below PX4's default failsafe thresholds
LINK_OFF_S = 30.0  # duration of a dead link; no command can arrive to end this fault
LINK_OFF_AFTER_S = 0.3  # time from the command to the dead link, so that the acknowledgement passes


def _unhealthy(sensor: str, *kinds: int) -> dict[int, FaultSpec]:
    return dict.fromkeys(kinds, FaultSpec(fault="sensor_unhealthy", params={"sensor": sensor}))


_FAULTS: dict[int, dict[int, FaultSpec]] = {
    mavlink.FAILURE_UNIT_SENSOR_GYRO: _unhealthy("gyro", OFF, STUCK),
    mavlink.FAILURE_UNIT_SENSOR_ACCEL: _unhealthy("accel", OFF, STUCK),
    mavlink.FAILURE_UNIT_SENSOR_MAG: _unhealthy("mag", OFF, STUCK),
    mavlink.FAILURE_UNIT_SENSOR_BARO: _unhealthy("baro", OFF, STUCK),
    mavlink.FAILURE_UNIT_SENSOR_AIRSPEED: _unhealthy("airspeed", OFF, WRONG),
    mavlink.FAILURE_UNIT_SENSOR_GPS: {
        OFF: FaultSpec(fault="gps_loss"),
        STUCK: FaultSpec(fault="gps_loss"),  # an estimator rejects repeated positions
        WRONG: FaultSpec(fault="gps_glitch", params={"east_m": 100.0}),
    },
    mavlink.FAILURE_UNIT_SYSTEM_BATTERY: {
        OFF: FaultSpec(fault="battery_sag", params={"sag_v": 0.0, "at_most": EMPTY_CHARGE})
    },
    MOTOR: {OFF: FaultSpec(fault="motor_loss")},
    mavlink.FAILURE_UNIT_SYSTEM_RC_SIGNAL: {OFF: FaultSpec(fault="rc_loss")},
    mavlink.FAILURE_UNIT_SYSTEM_MAVLINK_SIGNAL: {
        OFF: FaultSpec(fault="link_outage", at_s=LINK_OFF_AFTER_S, for_s=LINK_OFF_S),
        GARBAGE: FaultSpec(fault="corruption", params={"rate": 0.3}),
        SLOW: FaultSpec(fault="bandwidth", params={"rate_bytes_s": 1000.0}),
        DELAYED: FaultSpec(fault="delay", params={"delay_s": 1.0}),
        INTERMITTENT: FaultSpec(fault="burst_loss", params={"rate": 0.5, "burst_frames": 20.0}),
    },
}


def inject_failure(unit: float, kind: float, instance: float, replace: Replace, now: float) -> int:
    """Carry out MAV_CMD_INJECT_FAILURE with parameters 1 to 3 at `now` [s]; return the MAV_RESULT.

    Instance 0 means all instances of a unit. Only motors have more than one instance. FAILURE_TYPE_OK ends
    the faults that this command has begun on these instances.
    """
    try:
        unit, kind, instance = round(unit), round(kind), round(instance)
    except (ValueError, OverflowError):  # NaN or infinity
        return UNSUPPORTED
    count = N_MOTORS if unit == MOTOR else 1
    if unit not in _FAULTS or not 0 <= instance <= count:
        return UNSUPPORTED
    instances = range(1, count + 1) if instance == 0 else [instance]
    if kind == mavlink.FAILURE_TYPE_OK:
        faults: list[FaultSpec] = []
    elif kind in _FAULTS[unit]:
        faults = [_FAULTS[unit][kind]]
    else:
        return UNSUPPORTED
    for number in instances:
        replace(("failure", unit, number), faults, now)
    return ACCEPTED
