"""The GPS receiver has no fix."""

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect


def begin(target: FaultTarget, _params: FaultParams, now: float) -> EndFault:
    return target.apply(FaultEffect(gps_lost=True), now)


FAULT = Fault("gps_loss", "no GPS fix", FaultParams, begin)
