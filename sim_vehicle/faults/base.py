"""What a fault is: its parameters, and a function that begins it on a vehicle and returns what ends it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from sim_vehicle.vehicle.injected_faults import FaultEffect, InjectedFaults
from sim_vehicle.wire.channel import Channel, Direction, Stage

EndFault = Callable[[float], None]  # called with the time of the end [s]
LinkDirections = Literal["both", "to_vehicle", "from_vehicle"]
Share = Annotated[float, Field(ge=0, le=1)]
DIRECTION: Any = Field(default="both", description="which direction it is in")


class FaultParams(BaseModel):
    """Parameters of one fault; units are in the names, [s] for `_s` and so on."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True, slots=True)
class FaultTarget:
    """One vehicle as a fault sees it.

    channel: its wire, made when it is first asked for.
    afflictions: what is wrong with the vehicle itself.
    generator: makes randomness of one's own.
    reboot: restarts the autopilot at a time [s], silent for so long [s].
    every_tick: has a function called with the time [s] on each tick, until the function returned is called.
    """

    channel: Callable[[], Channel]
    injected_faults: InjectedFaults
    generator: Callable[[], np.random.Generator]
    reboot: Callable[[float, float], None]
    every_tick: Callable[[Callable[[float], None]], Callable[[], None]]

    def disturb(self, way: LinkDirections, make_stage: Callable[[np.random.Generator], Stage]) -> EndFault:
        """Put a stage of its own into each direction that `way` names; returns what takes them out."""
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
        """Have an effect on the vehicle itself from `now` [s]; returns what ends it."""
        return self.injected_faults.begin(effect, now)


BeginFault = Callable[[FaultTarget, Any, float], EndFault]


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault: `begin(target, params, now)` starts it at `now` [s] and returns what ends it."""

    name: str
    summary: str  # one line
    params: type[FaultParams]
    begin: BeginFault
