"""Bits flip in transit; the receiver rejects nearly all corrupted frames by the checksum."""

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
    rate: Share = Field(default=0.1, description="share of the frames corrupted")
    # In the covered fields the checksum detects all errors of up to three bits and nearly all larger errors.
    bits: Annotated[int, Field(ge=1, le=64)] = Field(
        default=3, description="largest number of flipped bits in a frame"
    )
    direction: LinkDirections = DIRECTION


class Corruption:
    """A stage that flips 1 to `bits` different bits in a share of the frames."""

    in_order = True

    def __init__(self, rate: float, bits: int, rng: np.random.Generator) -> None:
        self._rate, self._bits, self._rng = rate, bits, rng

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        if not frame or self._rng.random() >= self._rate:
            return [(frame, due_s)]
        flips = min(int(self._rng.integers(1, self._bits + 1)), 8 * len(frame))
        corrupted = bytearray(frame)
        for bit in self._rng.choice(8 * len(frame), size=flips, replace=False).tolist():
            corrupted[bit // 8] ^= 1 << bit % 8
        return [(bytes(corrupted), due_s)]


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    return target.disturb(params.direction, lambda rng: Corruption(params.rate, params.bits, rng))


FAULT = Fault("corruption", "bits flip in transit", Params, begin)
