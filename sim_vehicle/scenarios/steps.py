"""What a scenario's ground station does, and what its checks ask, as the file writes them."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from sim_vehicle.scenarios.base import Metres, Nothing, Number, OneOf, Seconds, Section, SystemId
from sim_vehicle.scenarios.checks import When, settings_of
from sim_vehicle.scenarios.plan import Height, number


class GoTo(Section):
    """A place from the vehicle's start, height above home [m]."""

    east_m: Metres
    north_m: Metres
    height_m: Height


class RawCommand(Section):
    """Any MAV_CMD as COMMAND_LONG."""

    command: str | int
    params: Annotated[tuple[Number, ...], Field(max_length=7)] = ()

    @field_validator("command")
    @classmethod
    def _known(cls, value: str | int) -> str | int:
        number("MAV_CMD_", value)
        return value


class Step(OneOf):
    """One thing the ground station does with each vehicle that is meant.

    It begins at `at_s` [s], but not before the vehicle's step before has ended; it is tried again for
    `timeout_s` while the vehicle answers nothing or "not now".
    """

    at_s: Seconds = 0.0
    timeout_s: Seconds = 120.0
    vehicles: Annotated[tuple[SystemId, ...], Field(min_length=1)] | None = None  # None: all
    expect: Literal["accepted", "refused", "any"] = "accepted"

    fly_mission: Nothing | None = None  # upload, arm and start, as the autopilot wants it
    upload_mission: Nothing | None = None
    upload_fence: Nothing | None = None
    start_mission: Nothing | None = None
    arm: Nothing | None = None
    disarm: Nothing | None = None
    takeoff: Height | None = None  # m above home; arms
    mode: str | None = None
    rtl: Nothing | None = None
    land: Nothing | None = None
    goto: GoTo | None = None
    command: RawCommand | None = None
    param: Annotated[dict[str, Number], Field(min_length=1)] | None = None
    heartbeat: bool | None = None  # of the ground station, to all vehicles
    reboot: Nothing | None = None

    @model_validator(mode="after")
    def _heartbeats_reach_all(self) -> Self:
        if self.heartbeat is not None and self.vehicles is not None:
            raise ValueError("heartbeats reach all vehicles; leave `vehicles` out")
        return self

    @classmethod
    def common(cls) -> frozenset[str]:
        return frozenset({"at_s", "timeout_s", "vehicles", "expect"})


class CheckSpec(Section):
    """One check: its name in the registry, its argument, and whom and when it is about.

    always: true on every step from `from_s` to `until_s`. eventually: true on one step by `by_s` (or the end
    of the run). end: true when the run ends.
    """

    name: str
    value: float | str | None = None
    vehicles: Annotated[tuple[SystemId, ...], Field(min_length=1)] | None = None
    when: When
    from_s: Seconds = 0.0
    until_s: Seconds | None = None
    by_s: Seconds | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_one_line(cls, data: Any) -> Any:
        """`no_crash`, `min_separation_m: 5` or `landed: {by_s: 300}` are all checks."""
        return settings_of(data)

    @model_validator(mode="after")
    def _times_fit(self) -> Self:
        if self.by_s is not None and self.when != "eventually":
            raise ValueError(f"`by_s` is for what happens eventually; {self.name} is looked at {self.when}")
        if self.when == "end" and (self.from_s > 0 or self.until_s is not None):
            raise ValueError(
                f"{self.name} is looked at when the run ends, not from `from_s` to `until_s`; "
                "leave them out, or say `when: always` or `when: eventually`"
            )
        for name, time_s in (("until_s", self.until_s), ("by_s", self.by_s)):
            if time_s is not None and time_s <= self.from_s:
                raise ValueError(f"`{name}` ({time_s:g}) must be later than `from_s` ({self.from_s:g})")
        return self
