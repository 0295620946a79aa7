"""The interface of a fault: parameters, begin function and end function."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from sim_vehicle.vehicle.injected_faults import FaultEffect, InjectedFaults
from sim_vehicle.wire.channel import Channel, Direction, Stage

EndFault = Callable[[float], None]  # called with the end time [s]
LinkDirections = Literal["both", "to_vehicle", "from_vehicle"]
Share = Annotated[float, Field(ge=0, le=1)]
DIRECTION: Any = Field(default="both", description="affected direction")


class FaultParams(BaseModel):
    """Parameters of one fault; a name can end in the unit, such as `_s` for seconds."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True, slots=True)
class VehicleAccess:
    """The parts of one vehicle that faults change.

    channel: returns the impaired link, created on the first call.
    injected_faults: effects on the vehicle.
    reboot: restarts the autopilot at a time [s] with a silence [s].
    """

    channel: Callable[[], Channel]
    injected_faults: InjectedFaults
    reboot: Callable[[float, float], None]


@dataclass(frozen=True, slots=True)
class FaultTarget:
    """One vehicle, and what the schedule offers to its fault.

    generator: returns a new random generator at each call.
    every_tick: registers a callback for each tick (time [s]); returns a function that removes the callback.
    """

    vehicle: VehicleAccess
    generator: Callable[[], np.random.Generator]
    every_tick: Callable[[Callable[[float], None]], Callable[[], None]]

    def disturb(
        self, affected: LinkDirections, make_stage: Callable[[np.random.Generator], Stage]
    ) -> EndFault:
        """Add a stage to each affected direction; return a function that removes the stages."""
        channel = self.vehicle.channel()
        removals = [
            channel.add(direction, make_stage(self.generator()))
            for direction in Direction
            if affected in ("both", direction.value)
        ]

        def end(_now: float) -> None:
            for remove in removals:
                remove()

        return end

    def apply(self, effect: FaultEffect, now: float) -> EndFault:
        """Apply an effect to the vehicle from `now` [s]; return the function that ends the effect."""
        return self.vehicle.injected_faults.begin(effect, now)


BeginFault = Callable[[FaultTarget, Any, float], EndFault]  # target, parameters, time [s] -> end function


@dataclass(frozen=True, slots=True)
class Fault:
    name: str
    summary: str  # one line
    params: type[FaultParams]
    begin: BeginFault
