"""The shape of a fault: its parameters, and a function that begins it and returns one that ends it."""

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
    """Parameters of one fault; units are in the names, [s] for `_s` and so on."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True, slots=True)
class FaultTarget:
    """One vehicle as a fault sees it.

    channel: its link, created on the first call.
    injected_faults: effects on the vehicle itself.
    generator: makes a random generator for the fault.
    reboot: restarts the autopilot at a time [s] with a silence [s].
    every_tick: calls a function with the time [s] on each tick, until the returned function is called.
    """

    channel: Callable[[], Channel]
    injected_faults: InjectedFaults
    generator: Callable[[], np.random.Generator]
    reboot: Callable[[float, float], None]
    every_tick: Callable[[Callable[[float], None]], Callable[[], None]]

    def disturb(self, way: LinkDirections, make_stage: Callable[[np.random.Generator], Stage]) -> EndFault:
        """Add a stage to each direction that `way` names; return a function that removes them."""
        channel = self.channel()
        removals = [
            channel.add(direction, make_stage(self.generator()))
            for direction in Direction
            if way in ("both", direction.value)
        ]

        def end(_now: float) -> None:
            for remove in removals:
                remove()

        return end

    def apply(self, effect: FaultEffect, now: float) -> EndFault:
        """Apply an effect to the vehicle itself from `now` [s]; return a function that ends it."""
        return self.injected_faults.begin(effect, now)


BeginFault = Callable[[FaultTarget, Any, float], EndFault]


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault: `begin(target, params, now)` starts it at `now` [s] and returns its end function."""

    name: str
    summary: str  # one line
    params: type[FaultParams]
    begin: BeginFault
