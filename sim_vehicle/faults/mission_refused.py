"""Uploads of missions, fences and rally points are refused."""

from enum import Enum
from typing import Annotated

from pydantic import Field
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.base import EndFault, Fault, FaultParams, FaultTarget
from sim_vehicle.vehicle.injected_faults import FaultEffect, MissionRefusal


class Result(Enum):
    ERROR = "error"
    UNSUPPORTED_FRAME = "unsupported_frame"
    UNSUPPORTED = "unsupported"
    NO_SPACE = "no_space"
    INVALID = "invalid"
    INVALID_SEQUENCE = "invalid_sequence"
    DENIED = "denied"
    OPERATION_CANCELLED = "operation_cancelled"

    @property
    def number(self) -> int:
        return int(getattr(mavlink, f"MAV_MISSION_{self.name}"))


class Params(FaultParams):
    result: Result = Field(default=Result.ERROR, description="MAV_MISSION_RESULT of the refusal")
    at_item: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="item at which the upload is refused; none: at MISSION_COUNT"
    )


def begin(target: FaultTarget, params: Params, now: float) -> EndFault:
    refusal = MissionRefusal(params.result.number, params.at_item)
    return target.apply(FaultEffect(mission_refusal=refusal), now)


FAULT = Fault("mission_refused", "uploads of missions, fences and rally points are refused", Params, begin)
