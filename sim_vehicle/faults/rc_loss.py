"""The remote control is lost."""

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect


def begin(target: FaultTarget, _params: FaultParams, now: float) -> EndFault:
    return target.apply(FaultEffect(rc_lost=True), now)


FAULT = Fault("rc_loss", "the remote control is lost", FaultParams, begin)
