"""The pilot's remote control is not heard."""

from sim_vehicle.faults.base import End, Fault, FaultParams, Target
from sim_vehicle.vehicle.injected_faults import Effect


class Params(FaultParams):
    pass


def begin(target: Target, _params: Params, now: float) -> End:
    return target.afflict(Effect(rc_lost=True), now)


FAULT = Fault("rc_loss", "the remote control is lost", Params, begin)
