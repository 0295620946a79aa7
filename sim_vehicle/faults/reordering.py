"""Frames overtake each other."""

from typing import Annotated

import numpy as np
from pydantic import Field

from sim_vehicle.faults.base import (
    DIRECTION,
    EndFault,
    Fault,
    FaultParams,
    FaultTarget,
    LinkDirections,
    Share,
)
from sim_vehicle.wire.channel import TimedFrames


class Params(FaultParams):
    rate: Share = Field(default=0.1, description="share of the frames delayed")
    hold_s: Annotated[float, Field(gt=0, le=60)] = Field(default=0.2, description="longest delay of a frame")
    direction: LinkDirections = DIRECTION


class Reordering:
    """A stage that delays a share of the frames by up to hold_s (uniform); later frames can overtake."""

    in_order = False

    def __init__(self, rate: float, hold_s: float, rng: np.random.Generator) -> None:
        self._rate, self._hold_s, self._rng = rate, hold_s, rng

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        delayed = self._rng.random() < self._rate
        return [(frame, due_s + (self._hold_s * self._rng.random() if delayed else 0.0))]


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    return target.disturb(params.direction, lambda rng: Reordering(params.rate, params.hold_s, rng))


FAULT = Fault("reordering", "frames overtake each other", Params, begin)
