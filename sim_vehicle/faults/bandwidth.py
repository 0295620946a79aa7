"""The link has a limited byte rate and a finite buffer."""

from typing import Annotated

import numpy as np
from pydantic import Field

from sim_vehicle.faults.base import DIRECTION, EndFault, Fault, FaultParams, FaultTarget, LinkDirections
from sim_vehicle.wire.channel import TimedFrames


class Params(FaultParams):
    rate_bytes_s: Annotated[float, Field(ge=10)] = Field(default=5000.0, description="rate of each direction")
    buffer_bytes: Annotated[int, Field(ge=300)] = Field(
        default=2048, description="buffer size; a frame that does not fit into the buffer is lost"
    )
    direction: LinkDirections = DIRECTION


class Bandwidth:
    """A stage that limits the byte rate and drops a frame that does not fit into the buffer."""

    in_order = True

    def __init__(self, rate_bytes_s: float, buffer_bytes: int) -> None:
        self._rate_bytes_s, self._buffer_bytes = rate_bytes_s, buffer_bytes
        self._free_from_s = 0.0  # end of the latest transmission

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        start_s = max(self._free_from_s, due_s)
        waiting_bytes = (start_s - due_s) * self._rate_bytes_s
        if waiting_bytes + len(frame) > self._buffer_bytes:
            return []
        self._free_from_s = start_s + len(frame) / self._rate_bytes_s
        return [(frame, self._free_from_s)]


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    def stage(_rng: np.random.Generator) -> Bandwidth:
        return Bandwidth(params.rate_bytes_s, params.buffer_bytes)

    return target.disturb(params.direction, stage)


FAULT = Fault("bandwidth", "a limited byte rate, with a finite buffer", Params, begin)
