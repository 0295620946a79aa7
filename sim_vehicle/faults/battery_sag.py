"""The battery's voltage drops, or its charge is limited."""

from typing import Annotated

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget, Share
from sim_vehicle.vehicle.injected_faults import FaultEffect


class Params(FaultParams):
    sag_v: Annotated[float, Field(ge=0, le=60)] = Field(default=1.5, description="drop of the voltage")
    at_most: Share = Field(
        default=1.0, description="upper limit of the charge, as a share of the full charge"
    )


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    return target.apply(FaultEffect(battery_sag_v=params.sag_v, battery_at_most=params.at_most), now)


FAULT = Fault("battery_sag", "the battery's voltage or charge drops", Params, begin)
