"""Injected faults of one vehicle, except faults of the link."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from sim_vehicle.physics.world import World
from sim_vehicle.wire.status import Status


class ModeStuck(Enum):
    """Answer to a mode change by a vehicle whose mode is stuck."""

    ACCEPTED = "accepted"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class MissionRefusal:
    """Refusal of a mission upload."""

    result: int  # MAV_MISSION_RESULT
    at_item: int | None = None  # index of the refused item; None: MISSION_COUNT is refused


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultEffect:
    """The effects of one fault; by default no effect."""

    gps_lost: bool = False
    gps_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)  # east, north, up
    battery_sag_v: float = 0.0
    battery_at_most: float = 1.0  # upper limit of the charge, as a share of the full charge
    motors_lost: int = 0
    rc_lost: bool = False
    mission_refusal: MissionRefusal | None = None
    ack_delay_s: float = 0.0
    ack_loss: float = 0.0  # share of lost acknowledgements, in [0, 1]
    mode_stuck: ModeStuck | None = None
    unhealthy_sensors: int = 0  # MAV_SYS_STATUS_SENSOR bits
    clock_drift_ppm: float = 0.0


class InjectedFaults:
    """The combined effects on one vehicle, as attributes with the names of `FaultEffect`.

    - sum: position offset, battery sag, lost motors, clock drift
    - largest: acknowledgement delay and loss; smallest: charge limit
    - latest: mission refusal, stuck mode

    changed: function (faults, now), called after each change.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        changed: Callable[["InjectedFaults", float], None] = lambda _faults, _now: None,
    ) -> None:
        self._rng = rng
        self._changed = changed
        self._effects: dict[int, FaultEffect] = {}
        self._next_key = 0
        self._clock_offset_s = 0.0
        self._clock_since_s = 0.0
        self._combine()

    def begin(self, effect: FaultEffect, now: float) -> Callable[[float], None]:
        """Add an effect at `now` [s] and return a function that ends the effect at a given time [s]."""
        key = self._next_key
        self._next_key += 1
        self._set(key, effect, now)
        return lambda end_s: self._set(key, None, end_s)

    def loses_ack(self) -> bool:
        """Draw a random number; return True if the next acknowledgement is lost."""
        return self.ack_loss > 0 and bool(self._rng.random() < self.ack_loss)

    def clock_offset_s(self, now: float) -> float:
        """Return the lead of the vehicle's clock at `now` [s], including drift of ended faults."""
        return self._clock_offset_s + (now - self._clock_since_s) * self.clock_drift_ppm * 1e-6

    def _set(self, key: int, effect: FaultEffect | None, now: float) -> None:
        self._clock_offset_s = self.clock_offset_s(now)
        self._clock_since_s = now
        if effect is None:
            self._effects.pop(key, None)
        else:
            self._effects[key] = effect
        self._combine()
        self._changed(self, now)

    def _combine(self) -> None:
        effects = tuple(self._effects.values())
        self.gps_lost = any(e.gps_lost for e in effects)
        self.gps_offset_m = (
            sum(e.gps_offset_m[0] for e in effects),
            sum(e.gps_offset_m[1] for e in effects),
            sum(e.gps_offset_m[2] for e in effects),
        )
        self.battery_sag_v = sum(e.battery_sag_v for e in effects)
        self.battery_at_most = min((e.battery_at_most for e in effects), default=1.0)
        self.motors_lost = sum(e.motors_lost for e in effects)
        self.rc_lost = any(e.rc_lost for e in effects)
        self.ack_delay_s = max((e.ack_delay_s for e in effects), default=0.0)
        self.ack_loss = max((e.ack_loss for e in effects), default=0.0)
        self.unhealthy_sensors = 0
        for effect in effects:
            self.unhealthy_sensors |= effect.unhealthy_sensors
        self.clock_drift_ppm = sum(e.clock_drift_ppm for e in effects)
        refusals = [e.mission_refusal for e in effects if e.mission_refusal is not None]
        self.mission_refusal = refusals[-1] if refusals else None
        stuck = [e.mode_stuck for e in effects if e.mode_stuck is not None]
        self.mode_stuck = stuck[-1] if stuck else None


class FaultEffectWriter:
    """Writer of one vehicle's faults into the fleet's arrays, called after each change of the faults."""

    def __init__(self, world: World, status: Status, index: int) -> None:
        self._world, self._status, self._index = world, status, index
        self._at_most, self._taken_mah = 1.0, 0.0

    def __call__(self, injected_faults: InjectedFaults, now: float) -> None:
        world, status, i = self._world, self._status, self._index
        world.gps.lost[i] = injected_faults.gps_lost
        world.gps.offset_m[i] = injected_faults.gps_offset_m
        world.batteries.sag_v[i] = injected_faults.battery_sag_v
        world.dynamics.motors_lost[i] = injected_faults.motors_lost
        status.clock_offset_s[i] = injected_faults.clock_offset_s(now)
        status.clock_since_s[i] = now
        status.clock_drift[i] = injected_faults.clock_drift_ppm * 1e-6
        self._take_charge(injected_faults.battery_at_most)
        world.has_event[i] = True  # wakes the autopilot

    def _take_charge(self, at_most: float) -> None:
        """Limit the charge to `at_most` (share of the full charge); a higher limit restores charge."""
        if at_most == self._at_most:
            return
        self._at_most = at_most
        batteries, i = self._world.batteries, self._index
        batteries.used_mah[i] -= self._taken_mah
        capacity_mah = float(batteries.capacity_mah[i])
        remaining_mah = capacity_mah - float(batteries.used_mah[i])
        self._taken_mah = max(remaining_mah - at_most * capacity_mah, 0.0)
        batteries.used_mah[i] += self._taken_mah
