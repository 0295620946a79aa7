"""The GPS receiver reports a wrong position, by a jump or by a ramp as in spoofing."""

from typing import Annotated

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect

Offset = Annotated[float, Field(ge=-1e6, le=1e6)]


class Params(FaultParams):
    east_m: Offset = Field(default=30.0, description="error eastward")
    north_m: Offset = Field(default=0.0, description="error northward")
    up_m: Offset = Field(default=0.0, description="error upward")
    ramp_s: Annotated[float, Field(ge=0)] = Field(default=0.0, description="duration of the ramp; 0: a jump")


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    def effect(share: float) -> FaultEffect:
        return FaultEffect(gps_offset_m=(params.east_m * share, params.north_m * share, params.up_m * share))

    if params.ramp_s == 0:
        return target.apply(effect(1.0), now)

    end_effect = target.apply(effect(0.0), now)

    def grow(tick_s: float) -> None:
        nonlocal end_effect
        end_effect(tick_s)
        share = min((tick_s - now) / params.ramp_s, 1.0)
        end_effect = target.apply(effect(share), tick_s)
        if share == 1.0:
            stop_growing()

    stop_growing = target.every_tick(grow)

    def end(end_s: float) -> None:
        stop_growing()
        end_effect(end_s)

    return end


FAULT = Fault("gps_glitch", "the GPS reports a wrong position, by a jump or by a ramp", Params, begin)
