"""Acknowledgements of commands and uploads are lost."""

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget, Share
from sim_vehicle.vehicle.injected_faults import FaultEffect


class Params(FaultParams):
    rate: Share = Field(default=1.0, description="share of the acknowledgements lost")


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(ack_loss=params.rate), now)


FAULT = Fault("absent_ack", "COMMAND_ACK and MISSION_ACK are lost", Params, begin)
