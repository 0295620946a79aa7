"""Commands and uploads are acknowledged late."""

from typing import Annotated

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect


class Params(FaultParams):
    delay_s: Annotated[float, Field(gt=0, le=60)] = Field(
        default=2.0, description="delay of acknowledgements"
    )


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(ack_delay_s=params.delay_s), now)


FAULT = Fault("slow_ack", "COMMAND_ACK and MISSION_ACK arrive late", Params, begin)
