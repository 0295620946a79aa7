"""The link carries frames in one direction only."""

from typing import Literal

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.faults.link_outage import Silence


class Params(FaultParams):
    dead: Literal["to_vehicle", "from_vehicle"] = Field(
        default="to_vehicle", description="direction in which no frame passes"
    )


def begin(target: FaultTarget, params: Params, _now: float) -> EndFault:
    return target.disturb(params.dead, lambda _rng: Silence())


FAULT = Fault("one_way", "the link is dead in one direction", Params, begin)
