"""The base classes of faults. The fields of a fault are its parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from sim_vehicle.vehicle.injected_faults import FaultEffect, InjectedFaults
from sim_vehicle.wire.channel import Channel, Direction, Stage

EndFault = Callable[[float], None]  # called with the end time [s]
LinkDirections = Literal["both", "to_vehicle", "from_vehicle"]
Share = Annotated[float, Field(ge=0, le=1)]
DIRECTION: Any = Field(default="both", description="affected direction")


@dataclass(frozen=True, slots=True)
class VehicleAccess:
    """The parts of one vehicle that faults change."""

    channel: Callable[[], Channel]  # returns the impaired link, created on the first call
    injected_faults: InjectedFaults
    reboot: Callable[[float, float], None]  # restarts the autopilot at a time [s] with a silence [s]


@dataclass(frozen=True, slots=True)
class FaultTarget:
    """One vehicle, and what the schedule offers to its fault."""

    vehicle: VehicleAccess
    generator: Callable[[], np.random.Generator]  # returns a new random generator at each call
    # registers a callback for each tick (time [s]); returns a function that removes the callback
    every_tick: Callable[[Callable[[float], None]], Callable[[], None]]


class Fault(BaseModel):
    """One kind of fault; the name of a parameter can end in the unit, such as `_s` for seconds."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    name: ClassVar[str]
    summary: ClassVar[str]  # one line

    def begin(self, target: FaultTarget, now: float) -> EndFault:
        """Begin the fault at `now` [s]; return the function that ends the fault."""
        raise NotImplementedError


class VehicleFault(Fault):
    """A fault with a constant effect on the vehicle."""

    def effect(self) -> FaultEffect:
        raise NotImplementedError

    def begin(self, target: FaultTarget, now: float) -> EndFault:
        return target.vehicle.injected_faults.begin(self.effect(), now)


class LinkFault(Fault):
    """A fault of the link."""

    @property
    def affected(self) -> LinkDirections:
        """Return the field `direction`; a fault without this field affects both directions."""
        affected: LinkDirections = getattr(self, "direction", "both")
        return affected

    @property
    def in_order(self) -> bool:
        """Return True if the stage keeps the order of the frames."""
        return True

    def stage(self, rng: np.random.Generator) -> Stage:
        """Return the stage of one direction."""
        raise NotImplementedError

    def begin(self, target: FaultTarget, now: float) -> EndFault:
        channel = target.vehicle.channel()
        removals = [
            channel.add(direction, self.stage(target.generator()), in_order=self.in_order)
            for direction in Direction
            if self.affected in ("both", direction.value)
        ]

        def end(_now: float) -> None:
            for remove in removals:
                remove()

        return end
