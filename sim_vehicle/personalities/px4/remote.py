"""Manual control of PX4: a joystick's MANUAL_CONTROL, as COM_RC_IN_MODE allows.

RC_CHANNELS_OVERRIDE only shows in RC_CHANNELS, because no channel has a function (RC_MAP_*).
"""

import math
from collections.abc import Sequence
from typing import Any

from sim_vehicle.personalities.px4 import modes
from sim_vehicle.personalities.px4.flight_parameters import NO_STICKS
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.interface import Vehicle
from sim_vehicle.vehicle.sticks import Sticks

JOYSTICK_MODES = (1, 2, 3)  # COM_RC_IN_MODE
CHANNELS = 18  # of RC_CHANNELS_OVERRIDE
IGNORED = 0xFFFF
MOVING_TIME_S = 0.1  # time constant of the sticks' speed
ABOVE_CENTRE, ABOVE_LOWEST = 0.6, 0.1  # positions of the throttle that prevent arming
NEVER_S = -math.inf


class Remote:
    """Manual control of one vehicle (`interface.RemoteInput`)."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self.reset()

    def reset(self) -> None:
        self._sticks, self._sticks_s = Sticks(), NEVER_S
        self._channels_us, self._channels_s = [0] * CHANNELS, NEVER_S
        self._stick_rates = [0.0] * 4  # filtered, full range in each direction per second

    def receive(self, message: Any, now: float) -> None:
        vehicle = self._vehicle
        if message.get_type() == "RC_CHANNELS_OVERRIDE":
            pulses_us = [getattr(message, f"chan{n + 1}_raw") for n in range(CHANNELS)]
            self._channels_us = [0 if pulse_us == IGNORED else pulse_us for pulse_us in pulses_us]
            self._channels_s = now
            return
        allowed = int(vehicle.params["COM_RC_IN_MODE"]) in JOYSTICK_MODES
        if message.target not in (0, vehicle.sysid) or not allowed or vehicle.injected_faults.effect.rc_lost:
            return
        axes = (message.y / 1000, message.x / 1000, message.r / 1000, message.z / 500 - 1)
        roll, pitch, yaw, throttle = (max(-1.0, min(axis, 1.0)) for axis in axes)
        sticks = Sticks(roll, pitch, yaw, (throttle + 1) / 2)
        moving = self._moving(sticks, now)
        self._sticks, self._sticks_s = sticks, now
        vehicle.failsafes.receive_remote_frame(now)
        if not vehicle.armed and not vehicle.modes.chosen:
            vehicle.modes.enter(modes.POSITION)  # the initial mode with a joystick
        elif vehicle.armed and moving and self._may_take_over() and vehicle.modes.set(modes.POSITION, now):
            vehicle.announce("pilot_took_over")

    def _valid(self, now: float) -> bool:
        return now - self._sticks_s < self._vehicle.flight_parameters.rc.timeout_s

    def _moving(self, sticks: Sticks, now: float) -> bool:
        """Return True if a stick moves faster than COM_RC_STICK_OV (`MovingDiff`)."""
        before, duration_s = self._sticks, now - self._sticks_s
        if not self._valid(now) or duration_s <= 0:
            self._stick_rates = [0.0] * 4
            return False
        changes = (
            sticks.roll - before.roll,
            sticks.pitch - before.pitch,
            sticks.yaw - before.yaw,
            2 * (sticks.throttle - before.throttle),
        )
        share = duration_s / (MOVING_TIME_S + duration_s)
        self._stick_rates = [
            rate + share * (change / duration_s - rate)
            for rate, change in zip(self._stick_rates, changes, strict=True)
        ]
        return max(map(abs, self._stick_rates)) > self._vehicle.params["COM_RC_STICK_OV"] / 100

    def _may_take_over(self) -> bool:
        """Return True if moving sticks end the present mode (COM_RC_OVERRIDE, multicopter only)."""
        vehicle = self._vehicle
        if vehicle.body.plane or vehicle.mode.needs_pilot or vehicle.mode.terminates:
            return False
        bit = 2 if vehicle.mode.setpoints_only else 1
        return bool(int(vehicle.params["COM_RC_OVERRIDE"]) & bit)

    def channels_us(self, _now: float) -> Sequence[int]:
        return [*self._channels_us[: self.count], *[IGNORED] * (CHANNELS - self.count)]

    @property
    def count(self) -> int:
        """Number of channels in use; 0 if no override has arrived lately."""
        if self._vehicle.now - self._channels_s >= self._vehicle.flight_parameters.rc.timeout_s:
            return 0
        return max((n + 1 for n, pulse_us in enumerate(self._channels_us) if pulse_us), default=0)

    def sticks(self, now: float) -> Sticks:
        """Return the sticks; without manual control centred, in a manual mode with the throttle down."""
        if self._valid(now):
            return self._sticks
        return Sticks(throttle=0.0 if self._vehicle.mode.behaviour is Behaviour.MANUAL else 0.5)

    def missing(self, now: float) -> bool:
        return int(self._vehicle.params["COM_RC_IN_MODE"]) != NO_STICKS and not self._valid(now)

    def keeps_armed(self, _now: float) -> bool:
        return False


def stick_refusals(vehicle: Vehicle, now: float) -> list[str]:
    """Return the reason against arming by the throttle in a pilot's mode (`Commander::arm`)."""
    if not vehicle.mode.needs_pilot or vehicle.remote.missing(now):
        return []
    throttle = vehicle.remote.sticks(now).throttle
    if vehicle.mode.behaviour is Behaviour.MANUAL:
        return ["high throttle"] if throttle > ABOVE_LOWEST else []
    return ["throttle above center"] if throttle > ABOVE_CENTRE else []
