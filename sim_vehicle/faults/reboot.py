"""The autopilot restarts, also in flight."""

from typing import Annotated

from pydantic import Field

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget


class Params(FaultParams):
    silence_s: Annotated[float, Field(gt=0, le=600)] = Field(
        default=1.5, description="time until the boot text"
    )


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    target.vehicle.reboot(now, params.silence_s)
    return lambda _now: None


FAULT = Fault("reboot", "the autopilot restarts: silence, motors off, boot text", Params, begin)
