"""Motors stop."""

from typing import Annotated

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect


class Params(FaultParams):
    motors: Annotated[int, Field(ge=1, le=4)] = Field(default=1, description="number of lost motors")


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(motors_lost=params.motors), now)


FAULT = Fault(
    "motor_loss",
    "motors stop: a copter sinks (one motor) or falls (more motors), a plane glides",
    Params,
    begin,
)
