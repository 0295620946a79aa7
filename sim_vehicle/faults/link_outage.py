"""Nothing gets through."""

from sim_vehicle.faults.base import End, Fault, FaultParams, Target
from sim_vehicle.wire.channel import Passed


class Params(FaultParams):
    pass


class Silence:
    """Loses every frame."""

    in_order = True

    def __call__(self, frame: bytes, due_s: float) -> Passed:
        return []


def begin(target: Target, _params: Params, _now: float) -> End:
    return target.disturb("both", lambda _rng: Silence())


FAULT = Fault("link_outage", "nothing gets through either way", Params, begin)
