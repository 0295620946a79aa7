"""The GPS receiver has no fix."""

from sim_vehicle.faults.base import End, Fault, FaultParams, Target
from sim_vehicle.vehicle.injected_faults import Effect


class Params(FaultParams):
    pass


def begin(target: Target, _params: Params, now: float) -> End:
    return target.afflict(Effect(gps_lost=True), now)


FAULT = Fault("gps_loss", "no GPS fix", Params, begin)
