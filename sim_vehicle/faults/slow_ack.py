"""Commands and uploads are acknowledged late."""

from typing import Annotated

from pydantic import Field

from sim_vehicle.faults.base import End, Fault, FaultParams, Target
from sim_vehicle.vehicle.injected_faults import Effect


class Params(FaultParams):
    delay_s: Annotated[float, Field(gt=0, le=60)] = Field(default=2.0, description="how late")


def begin(target: Target, params: Params, now: float) -> End:
    return target.afflict(Effect(ack_delay_s=params.delay_s), now)


FAULT = Fault("slow_ack", "COMMAND_ACK and MISSION_ACK come late", Params, begin)
