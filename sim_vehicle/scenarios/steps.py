"""The steps and checks of a scenario file."""

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, create_model, model_validator

from sim_vehicle.scenarios.base import Metres, NoSettings, Number, OneOf, Seconds, Section, SystemId
from sim_vehicle.scenarios.checks import CHECKS, Check, When
from sim_vehicle.scenarios.plan import Command, Height


class GoTo(Section):
    """A position [m] from the vehicle's start, with its height above home."""

    east_m: Metres
    north_m: Metres
    height_m: Height


class RawCommand(Section):
    """Any MAV_CMD as COMMAND_LONG."""

    command: Command
    params: Annotated[tuple[Number, ...], Field(max_length=7)] = ()


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


class CheckSettings(Section):
    """The vehicles and times of one check.

    - `when: always`: the condition holds all the time from `from_s` to `until_s` [s] or the end of the run.
    - `when: eventually`: the condition holds once, from `from_s` to `by_s` or `until_s` [s] or the run's end.
    - `when: end`: the condition holds at the end of the run.
    """

    vehicles: Annotated[tuple[SystemId, ...], Field(min_length=1)] | None = None
    when: When
    from_s: Seconds = 0.0
    until_s: Seconds | None = None
    by_s: Seconds | None = None

    @model_validator(mode="after")
    def _times_fit(self) -> Self:
        if self.by_s is not None and self.when != "eventually":
            raise ValueError(
                f"`by_s` needs `when: eventually`, but this check has `when: {self.when}`; remove `by_s`"
            )
        if self.when == "end" and (self.from_s > 0 or self.until_s is not None):
            raise ValueError(
                "is evaluated at the end of the run, not from `from_s` to `until_s`; "
                "remove both times, or add `when: always` or `when: eventually`"
            )
        for name, time_s in (("until_s", self.until_s), ("by_s", self.by_s)):
            if time_s is not None and time_s <= self.from_s:
                raise ValueError(f"`{name}` ({time_s:g}) must be later than `from_s` ({self.from_s:g})")
        return self


def _settings(check: Check) -> Any:
    """Return the type of a check's settings, which may be the check's argument alone."""
    fields: dict[str, Any] = {"when": (When, check.when)}
    if check.argument is not None:
        fields[check.argument] = (check.type, ... if check.default is None else check.default)
    doc = f"{check.summary} Evaluated: {check.when}."
    model = create_model(check.name, __base__=CheckSettings, __doc__=doc, **fields)
    if check.argument is None:
        return model

    def from_argument(data: Any) -> Any:
        return data if isinstance(data, dict | model) else {check.argument: data}

    return Annotated[model, BeforeValidator(from_argument, json_schema_input_type=check.type | model)]


class _CheckSpec(OneOf):
    """One check with its settings: `no_crash`, `min_separation_m: 5` or `landed: {by_s: 300}`."""

    @property
    def settings(self) -> CheckSettings:
        settings: CheckSettings = getattr(self, self.chosen)
        return settings

    @property
    def vehicles(self) -> tuple[int, ...] | None:
        return self.settings.vehicles

    @property
    def argument(self) -> Any:
        """Return the check's argument, or None for a check without an argument."""
        name = CHECKS[self.chosen].argument
        return None if name is None else getattr(self.settings, name)


if TYPE_CHECKING:
    CheckSpec = _CheckSpec
else:
    CheckSpec = create_model(
        "CheckSpec",
        __base__=_CheckSpec,
        __doc__=_CheckSpec.__doc__,
        **{name: (_settings(check) | None, None) for name, check in CHECKS.items()},
    )
