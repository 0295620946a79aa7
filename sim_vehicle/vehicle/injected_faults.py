"""Injected faults of one vehicle, except faults of the link."""

import functools
import operator
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from sim_vehicle.physics.world import World
from sim_vehicle.wire.status import Status

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MissionRefusal:
    """Refusal of a mission upload."""

    result: int  # MAV_MISSION_RESULT
    at_item: int | None = None  # index of the refused item; None: MISSION_COUNT is refused


def _sum(vectors: Sequence[Vector]) -> Vector:
    return (sum(v[0] for v in vectors), sum(v[1] for v in vectors), sum(v[2] for v in vectors))


def _latest(values: Sequence[Any]) -> Any:
    return next((value for value in reversed(values) if value is not None), None)


def _bits(masks: Sequence[int]) -> int:
    return functools.reduce(operator.or_, masks)


# Rules that combine the effects of several faults.
_ANY, _SUM, _MIN, _MAX = ({"combine": rule} for rule in (any, sum, min, max))
_VECTOR_SUM, _LATEST, _BITS = ({"combine": rule} for rule in (_sum, _latest, _bits))


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultEffect:
    """The effects of a fault, or of all faults of a vehicle together."""

    gps_lost: bool = field(default=False, metadata=_ANY)
    gps_offset_m: Vector = field(default=(0.0, 0.0, 0.0), metadata=_VECTOR_SUM)  # east, north, up
    battery_sag_v: float = field(default=0.0, metadata=_SUM)
    battery_at_most: float = field(default=1.0, metadata=_MIN)  # limit of the charge, as a share
    motors_lost: int = field(default=0, metadata=_SUM)
    rc_lost: bool = field(default=False, metadata=_ANY)
    mission_refusal: MissionRefusal | None = field(default=None, metadata=_LATEST)
    ack_delay_s: float = field(default=0.0, metadata=_MAX)
    ack_loss: float = field(default=0.0, metadata=_MAX)  # share of lost acknowledgements, in [0, 1]
    # mode changes are not carried out: True if they are acknowledged, False if they are refused
    mode_stuck: bool | None = field(default=None, metadata=_LATEST)
    unhealthy_sensors: int = field(default=0, metadata=_BITS)  # MAV_SYS_STATUS_SENSOR bits
    clock_drift_ppm: float = field(default=0.0, metadata=_SUM)


def _together(effects: Iterable[FaultEffect]) -> FaultEffect:
    given = [FaultEffect(), *effects]
    return FaultEffect(
        **{f.name: f.metadata["combine"]([getattr(e, f.name) for e in given]) for f in fields(FaultEffect)}
    )


class InjectedFaults:
    """The faults of one vehicle; `effect` has their combined effects.

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
        self.effect = FaultEffect()

    def begin(self, effect: FaultEffect, now: float) -> Callable[[float], None]:
        """Add an effect at `now` [s] and return a function that ends the effect at a given time [s]."""
        key = self._next_key
        self._next_key += 1
        self._set(key, effect, now)
        return lambda end_s: self._set(key, None, end_s)

    def loses_ack(self) -> bool:
        """Draw a random number; return True if the next acknowledgement is lost."""
        return self.effect.ack_loss > 0 and bool(self._rng.random() < self.effect.ack_loss)

    def clock_offset_s(self, now: float) -> float:
        """Return the lead of the vehicle's clock at `now` [s], including drift of ended faults."""
        return self._clock_offset_s + (now - self._clock_since_s) * self.effect.clock_drift_ppm * 1e-6

    def _set(self, key: int, effect: FaultEffect | None, now: float) -> None:
        self._clock_offset_s = self.clock_offset_s(now)
        self._clock_since_s = now
        if effect is None:
            self._effects.pop(key, None)
        else:
            self._effects[key] = effect
        self.effect = _together(self._effects.values())
        self._changed(self, now)


class FaultEffectWriter:
    """Writer of one vehicle's faults into the fleet's arrays, called after each change of the faults."""

    def __init__(self, world: World, status: Status, index: int) -> None:
        self._world, self._status, self._index = world, status, index
        self._at_most, self._taken_mah = 1.0, 0.0

    def __call__(self, injected_faults: InjectedFaults, now: float) -> None:
        world, status, i, effect = self._world, self._status, self._index, injected_faults.effect
        world.gps.lost[i] = effect.gps_lost
        world.gps.offset_m[i] = effect.gps_offset_m
        world.batteries.sag_v[i] = effect.battery_sag_v
        world.dynamics.motors_lost[i] = effect.motors_lost
        status.clock_offset_s[i] = injected_faults.clock_offset_s(now)
        status.clock_since_s[i] = now
        status.clock_drift[i] = effect.clock_drift_ppm * 1e-6
        self._take_charge(effect.battery_at_most)
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
