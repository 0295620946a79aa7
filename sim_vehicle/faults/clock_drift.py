"""The vehicle's clock is fast or slow."""

from typing import Annotated

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect


class Params(FaultParams):
    # The error of a crystal is about 20 ppm, of an oscillator without a crystal about 10 000 ppm.
    drift_ppm: Annotated[float, Field(ge=-500_000, le=500_000)] = Field(
        default=1000.0, description="drift of the clock, positive if fast"
    )


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(clock_drift_ppm=params.drift_ppm), now)


FAULT = Fault("clock_drift", "time since boot, TIMESYNC and SYSTEM_TIME drift", Params, begin)
