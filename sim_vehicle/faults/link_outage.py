"""No frame passes in either direction."""

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.wire.channel import TimedFrames


class Silence:
    """A stage that drops every frame."""

    in_order = True

    def __call__(self, frame: bytes, due_s: float) -> TimedFrames:
        return []


def begin(target: FaultTarget, _params: FaultParams, _now: float) -> EndFault:
    return target.disturb("both", lambda _rng: Silence())


FAULT = Fault("link_outage", "no frame passes in either direction", FaultParams, begin)
