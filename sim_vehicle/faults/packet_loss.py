"""Frames get lost, each for itself."""

import numpy as np
from pydantic import Field

from sim_vehicle.faults.base import DIRECTION, End, Fault, FaultParams, Share, Target, Way
from sim_vehicle.wire.channel import Passed


class Params(FaultParams):
    rate: Share = Field(default=0.1, description="share of the frames that is lost")
    direction: Way = DIRECTION


class Loss:
    """Loses a share of the frames."""

    in_order = True

    def __init__(self, rate: float, rng: np.random.Generator) -> None:
        self._rate, self._rng = rate, rng

    def __call__(self, frame: bytes, due_s: float) -> Passed:
        return [] if self._rng.random() < self._rate else [(frame, due_s)]


def begin(target: Target, params: Params, _now: float) -> End:
    return target.disturb(params.direction, lambda rng: Loss(params.rate, rng))


FAULT = Fault("packet_loss", "frames are lost at random", Params, begin)
