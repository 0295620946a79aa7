"""The progress of a mission, as reported by the vehicle."""

from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.personalities import personality_of
from sim_vehicle.scenarios.model import VehicleSpec
from sim_vehicle.scenarios.plan import Leg
from sim_vehicle.vehicle.behaviour import Behaviour

MAX_STEPS = 200_000  # limit of the simulated mission entries; a longer mission counts as endless
DUPLICATE_WITHIN_S = 1.0  # an equal frame number within this time is a duplicate of the frame


class MissionProgress:
    """The completion of one vehicle's mission.

    - An autopilot with a mission state reports the completion.
    - Otherwise MISSION_ITEM_REACHED of the last item completes the mission, after all rounds of the jumps.
    - PX4 never reports a last item that returns; the mission is complete when this item is current.
    """

    def __init__(self, spec: VehicleSpec) -> None:
        personality = personality_of(spec.personality, spec.kind)
        flown = [i for i, leg in enumerate(spec.mission) if leg.flown]
        self._last_item = spec.item_of(flown[-1]) if flown else -1
        self._returns = bool(flown) and spec.mission[flown[-1]].returns
        self._lands_before = any(spec.mission[i].lands for i in flown[:-1])
        self._reports_state = personality.telemetry.mission_state
        self._mode = personality.modes.of(Behaviour.MISSION).number
        self._arrivals_needed = 0 if self._reports_state or not flown else _arrivals(spec.mission, flown[-1])
        self._last_item_seen = self._flown = False
        self._n_arrivals = 0
        self._last_arrival: tuple[int, float] | None = None  # frame number and time of the last arrival
        self.done = False

    def receive(self, message: Any, now: float) -> None:
        """Process any message of the vehicle."""
        kind = message.get_type()
        if kind == "HEARTBEAT":
            armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
            self._flown = self._flown or bool(armed and message.custom_mode == self._mode)
        elif kind == "MISSION_ITEM_REACHED" and message.seq == self._last_item:
            self._last_item_seen = True
            self._note_arrival(message.get_seq(), now)
        elif kind == "MISSION_CURRENT":
            self._last_item_seen = self._last_item_seen or message.seq == self._last_item
            self.done = self.done or self._reported_complete(message)

    def _reported_complete(self, message: Any) -> bool:
        if not self._reports_state:
            return self._returns and self._flown and bool(message.seq == self._last_item)
        # The autopilot also reports the completion after a landing before the last item.
        is_final = self._last_item_seen or not self._lands_before
        return is_final and getattr(message, "mission_state", 0) == mavlink.MISSION_STATE_COMPLETE

    def _note_arrival(self, frame: int, now: float) -> None:
        repeated = (
            self._last_arrival is not None
            and self._last_arrival[0] == frame
            and now - self._last_arrival[1] < DUPLICATE_WITHIN_S
        )
        self._last_arrival = frame, now
        self._n_arrivals += not repeated
        self.done = self.done or 0 < self._arrivals_needed <= self._n_arrivals


def _arrivals(legs: Sequence[Leg], last: int) -> int:
    """Return the number of arrivals at the leg `last` before the mission ends; 0 for an endless mission."""
    jumps = [0] * len(legs)
    index = arrivals = 0
    for _ in range(MAX_STEPS):
        if not 0 <= index < len(legs):
            return arrivals
        arrivals += index == last
        jump = legs[index].jump
        if jump is not None and (jump.times < 0 or jumps[index] < jump.times):
            jumps[index] += 1
            index = jump.to - 1
        else:
            index += 1
    return 0
