"""Frames are lost independently of each other."""

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
    rate: Share = Field(default=0.1, description="share of the frames lost")
    direction: LinkDirections = DIRECTION


class Loss:
    """A stage that drops a share of the frames at random."""

    in_order = True

    def __init__(self, rate: float, rng: np.random.Generator) -> None:
        self._rate, self._rng = rate, rng

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        return [] if self._rng.random() < self._rate else [(frame, due_s)]


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    return target.disturb(params.direction, lambda rng: Loss(params.rate, rng))


FAULT = Fault("packet_loss", "frames are lost at random", Params, begin)
