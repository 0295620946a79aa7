"""The flight mode does not change when a ground station asks."""

from pydantic import Field

from sim_vehicle.faults.base import End, Fault, FaultParams, Target
from sim_vehicle.vehicle.injected_faults import Effect, ModeStuck


class Params(FaultParams):
    answer: ModeStuck = Field(default=ModeStuck.ACCEPTED, description="what a request is answered with")


def begin(target: Target, params: Params, now: float) -> End:
    return target.afflict(Effect(mode_stuck=params.answer), now)


FAULT = Fault("stuck_mode", "mode changes are acknowledged, or refused, and not done", Params, begin)
