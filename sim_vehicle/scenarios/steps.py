"""The steps and checks of a scenario file."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from sim_vehicle.scenarios.base import Metres, NoSettings, Number, OneOf, Seconds, Section, SystemId
from sim_vehicle.scenarios.checks import When, settings_of
from sim_vehicle.scenarios.plan import Height, mavlink_number


class GoTo(Section):
    """A position [m] from the vehicle's start, with its height above home."""

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
        mavlink_number("MAV_CMD_", value)
        return value


class ScriptStep(OneOf):
    """One action of the ground station with each selected vehicle.

    A step begins at `at_s` [s], but not before the end of the vehicle's previous step. For up to `timeout_s`
    [s] the ground station repeats an unanswered message and, with `expect: accepted`, a refused message.
    """

    at_s: Seconds = 0.0
    timeout_s: Seconds = 120.0
    vehicles: Annotated[tuple[SystemId, ...], Field(min_length=1)] | None = None  # None: all
    expect: Literal["accepted", "refused", "any"] = "accepted"

    fly_mission: NoSettings | None = None  # upload, arm and start
    upload_mission: NoSettings | None = None
    upload_fence: NoSettings | None = None
    start_mission: NoSettings | None = None
    arm: NoSettings | None = None
    disarm: NoSettings | None = None
    takeoff: Height | None = None  # m above home; also arms
    mode: str | None = None
    rtl: NoSettings | None = None
    land: NoSettings | None = None
    goto: GoTo | None = None
    command: RawCommand | None = None
    param: Annotated[dict[str, Number], Field(min_length=1)] | None = None
    heartbeat: bool | None = None  # of the ground station, to all vehicles
    reboot: NoSettings | None = None

    @model_validator(mode="after")
    def _heartbeats_reach_all(self) -> Self:
        if self.heartbeat is not None and self.vehicles is not None:
            raise ValueError("heartbeats reach all vehicles; remove `vehicles`")
        return self

    @classmethod
    def common(cls) -> frozenset[str]:
        return frozenset({"at_s", "timeout_s", "vehicles", "expect"})


class CheckSpec(Section):
    """One check: name in the registry, argument (`value`), vehicles and times.

    - `when: always`: the condition holds all the time from `from_s` to `until_s` [s] or the end of the run.
    - `when: eventually`: the condition holds once, from `from_s` to `by_s` or `until_s` [s] or the run's end.
    - `when: end`: the condition holds at the end of the run.
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
        """Accept `no_crash`, `min_separation_m: 5` and `landed: {by_s: 300}`."""
        return settings_of(data)

    @model_validator(mode="after")
    def _times_fit(self) -> Self:
        if self.by_s is not None and self.when != "eventually":
            raise ValueError(
                f"`by_s` needs `when: eventually`, but {self.name} has `when: {self.when}`; remove `by_s`"
            )
        if self.when == "end" and (self.from_s > 0 or self.until_s is not None):
            raise ValueError(
                f"{self.name} is evaluated at the end of the run, not from `from_s` to `until_s`; "
                "remove both times, or add `when: always` or `when: eventually`"
            )
        for name, time_s in (("until_s", self.until_s), ("by_s", self.by_s)):
            if time_s is not None and time_s <= self.from_s:
                raise ValueError(f"`{name}` ({time_s:g}) must be later than `from_s` ({self.from_s:g})")
        return self
