"""The flight mode does not change when a ground station asks."""

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect, ModeStuck


class Params(FaultParams):
    answer: ModeStuck = Field(default=ModeStuck.ACCEPTED, description="what a request is answered with")


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(mode_stuck=params.answer), now)


FAULT = Fault("stuck_mode", "mode changes are acknowledged, or refused, and not done", Params, begin)
