"""The flight mode does not change on a ground station's request."""

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect, ModeStuck


class Params(FaultParams):
    answer: ModeStuck = Field(default=ModeStuck.ACCEPTED, description="answer to a mode change")


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(mode_stuck=params.answer), now)


FAULT = Fault("stuck_mode", "mode changes are acknowledged or refused, but not carried out", Params, begin)
