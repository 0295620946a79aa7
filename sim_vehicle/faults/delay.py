"""Frames arrive late, in their original order."""

import math
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sim_vehicle.faults.base import DIRECTION, EndFault, Fault, FaultParams, FaultTarget, LinkDirections
from sim_vehicle.wire.channel import TimedFrames

Seconds = Annotated[float, Field(ge=0, le=60)]


class Params(FaultParams):
    delay_s: Seconds = Field(default=0.5, description="mean delay in each direction")
    jitter_s: Seconds = Field(default=0.0, description="largest deviation from the mean delay")
    direction: LinkDirections = DIRECTION

    @model_validator(mode="after")
    def _check_jitter(self) -> Self:
        if self.jitter_s > self.delay_s:
            raise ValueError(f"jitter_s {self.jitter_s:g} must not exceed delay_s {self.delay_s:g}")
        return self


class Delay:
    """A stage that delays each frame by delay_s ± jitter_s (uniform) and keeps the order of frames."""

    in_order = True

    def __init__(self, delay_s: float, jitter_s: float, rng: np.random.Generator) -> None:
        self._delay_s, self._jitter_s, self._rng = delay_s, jitter_s, rng
        self._last_due_s = -math.inf

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        added_s = self._delay_s + self._jitter_s * self._rng.uniform(-1.0, 1.0)
        self._last_due_s = max(due_s + added_s, self._last_due_s)
        return [(frame, self._last_due_s)]


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    return target.disturb(params.direction, lambda rng: Delay(params.delay_s, params.jitter_s, rng))


FAULT = Fault("delay", "frames arrive late, with jitter", Params, begin)
