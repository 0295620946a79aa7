"""A share of the frames arrives twice."""

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
    rate: Share = Field(default=0.1, description="share of the frames duplicated")
    gap_s: Annotated[float, Field(ge=0, le=60)] = Field(
        default=0.0, description="time from a frame to its copy; other frames can arrive in between"
    )
    direction: LinkDirections = DIRECTION


class Duplication:
    """A stage that duplicates a share of the frames."""

    def __init__(self, rate: float, gap_s: float, rng: np.random.Generator) -> None:
        self._rate, self._gap_s, self._rng = rate, gap_s, rng
        self.in_order = gap_s == 0

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        copies = [(frame, due_s + self._gap_s)] if self._rng.random() < self._rate else []
        return [(frame, due_s), *copies]


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    return target.disturb(params.direction, lambda rng: Duplication(params.rate, params.gap_s, rng))


FAULT = Fault("duplication", "frames arrive twice", Params, begin)
