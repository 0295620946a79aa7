"""The remote control of ArduPilot: an RC receiver, and overrides of its channels by the ground station.

Only SYSID_MYGCS overrides. An override lasts RC_OVERRIDE_TIME. It counts as a frame of the remote control and
as a heartbeat of the ground station. The receiver's sticks stand in the middle, its throttle at the bottom.
"""

from collections.abc import Sequence
from typing import Any

from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.sticks import Sticks

RECEIVER_US = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)  # as in ArduPilot's SITL
CHANNELS, OLD_CHANNELS = 16, 8  # of RC_CHANNELS_OVERRIDE; 0 has another meaning in the first eight
ROLL, PITCH, THROTTLE, YAW = range(4)
LOWEST_US, MIDDLE_US, HIGHEST_US = 1000, 1500, 2000  # RCn_MIN, RCn_TRIM, RCn_MAX
DEADZONE_US, THROTTLE_DEADZONE_US = 20, 30  # RCn_DZ
IGNORED, RELEASED = 0xFFFF, 0xFFFE
NO_AXIS = 0x7FFF  # of MANUAL_CONTROL
_NAMES = ((ROLL, "Roll"), (PITCH, "Pitch"), (YAW, "Yaw"))


class Remote:
    """The remote control of one vehicle (`interface.RemoteInput`)."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._overrides: dict[int, tuple[int, float]] = {}  # channel -> pulse [us], time [s]

    def reset(self) -> None:
        self._overrides.clear()

    def receive(self, message: Any, now: float) -> None:
        vehicle, sysid = self._vehicle, message.get_srcSystem()
        if sysid != vehicle.flight_parameters.gcs.sysid:
            return
        if message.get_type() == "RC_CHANNELS_OVERRIDE":
            self._override(message, now)
        elif message.target != vehicle.sysid:
            return
        elif message.z >= 0 or vehicle.body.plane:  # a copter ignores the sticks of a negative thrust
            self._control(message, now)
        vehicle.failsafes.receive_heartbeat(sysid, now)

    def _override(self, message: Any, now: float) -> None:
        for channel in range(CHANNELS):
            pulse_us = getattr(message, f"chan{channel + 1}_raw")
            if pulse_us == IGNORED or (pulse_us == 0 and channel >= OLD_CHANNELS):
                continue
            released = pulse_us == RELEASED and channel >= OLD_CHANNELS
            self._overrides[channel] = (0 if released else pulse_us, now)
        self._vehicle.failsafes.receive_remote_frame(now)

    def _control(self, message: Any, now: float) -> None:
        """Set the four axes of MANUAL_CONTROL."""
        middle, ends = MIDDLE_US - LOWEST_US, HIGHEST_US - LOWEST_US
        axes = (
            (ROLL, message.y, middle + message.y / 2),
            (PITCH, message.x, middle - message.x / 2),
            (THROTTLE, message.z, message.z * ends / 1000),
            (YAW, message.r, middle + message.r / 2),
        )
        for channel, axis, pulse_us in axes:
            # An axis far outside of its range gives a negative pulse, which no message can report.
            self._overrides[channel] = (0 if axis == NO_AXIS else max(LOWEST_US + int(pulse_us), 1), now)
        self._vehicle.failsafes.receive_remote_frame(now)

    def channels_us(self, now: float) -> Sequence[int]:
        pulses_us = [*RECEIVER_US, *[0] * (CHANNELS - len(RECEIVER_US))]
        limit_s = self._vehicle.params["RC_OVERRIDE_TIME"]
        for channel, (pulse_us, since_s) in self._overrides.items():
            if pulse_us and limit_s != 0 and (limit_s < 0 or now - since_s < limit_s):
                pulses_us[channel] = pulse_us
        return pulses_us

    @property
    def count(self) -> int:
        return len(RECEIVER_US)

    def sticks(self, now: float) -> Sticks:
        """Return the sticks; in the middle, without power for a plane, while the remote control is lost."""
        if self._vehicle.failsafes.rc_lost:
            return Sticks(throttle=0.0) if self._vehicle.body.plane else Sticks()
        pulses_us = self.channels_us(now)
        return Sticks(
            roll=_deflection(pulses_us[ROLL]),
            pitch=-_deflection(pulses_us[PITCH]),
            yaw=_deflection(pulses_us[YAW]),
            throttle=_throttle(pulses_us[THROTTLE]),
        )

    def missing(self, _now: float) -> bool:
        return False

    def keeps_armed(self, now: float) -> bool:
        """Return True while the throttle of a copter is up, which delays the automatic disarming."""
        vehicle = self._vehicle
        counts = not vehicle.body.plane and not vehicle.failsafes.rc_lost
        return counts and _throttle(self.channels_us(now)[THROTTLE]) > 0


def _deflection(pulse_us: int) -> float:
    """Return a stick's position in [-1, 1]."""
    offset_us = max(abs(pulse_us - MIDDLE_US) - DEADZONE_US, 0)
    size = min(offset_us / (MIDDLE_US - LOWEST_US - DEADZONE_US), 1.0)
    return size if pulse_us > MIDDLE_US else -size


def _throttle(pulse_us: int) -> float:
    """Return the position of the throttle in [0, 1], 0.5 in its middle."""
    lowest_us = LOWEST_US + THROTTLE_DEADZONE_US
    if pulse_us < MIDDLE_US:
        return max(pulse_us - lowest_us, 0) / (MIDDLE_US - lowest_us) / 2
    return 0.5 + min((pulse_us - MIDDLE_US) / (HIGHEST_US - MIDDLE_US), 1.0) / 2


def stick_refusals(vehicle: Vehicle, now: float) -> list[str]:
    """Return the first reason against arming by the sticks (`AP_Arming::rc_arm_checks`)."""
    if not vehicle.flight_parameters.arming.checks or vehicle.failsafes.rc_lost:
        return []
    sticks, pilot = vehicle.remote.sticks(now), vehicle.flight_parameters.pilot
    behaviour = vehicle.mode.behaviour
    if not vehicle.body.plane and behaviour not in (Behaviour.GUIDED, Behaviour.MISSION):
        by_thrust = behaviour is Behaviour.MANUAL and sticks.throttle > 0
        if by_thrust or pilot.climb_rate_m_s(sticks.throttle) > 0:
            return ["Throttle too high"]
    pulses_us = vehicle.remote.channels_us(now)
    moved = [f"{name} (RC{n + 1})" for n, name in _NAMES if _deflection(pulses_us[n]) != 0]
    if sticks.throttle > 0:
        moved.append(f"Throttle (RC{THROTTLE + 1})")
    return [f"{name} is not neutral" for name in moved]
