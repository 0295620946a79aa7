"""The section `formations` of a configuration: groups that fly in a shape."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from swarmctl.agent.formation.approaches import APPROACHES
from swarmctl.agent.formation.shape import Shape
from swarmctl.core.operator_text import VEHICLE_NAME
from swarmctl.core.section import NameIn, Section


def _with_options_of_each_approach(schema: dict[str, Any]) -> None:
    """Add to the JSON schema of `options` the parameters of each approach."""
    schema["anyOf"] = [
        {**module.Params.model_json_schema(), "title": name} for name, module in APPROACHES.items()
    ]


class FormationSection(Section):
    """A group of vehicles that flies in a shape."""

    name: str = Field(pattern=VEHICLE_NAME, description="Name of the group.")
    members: tuple[int | str, ...] = Field(
        min_length=2,
        description="Vehicles by name or system id, in the order in which they take the places. The first "
        "vehicle that is present leads.",
    )
    approach: Annotated[str, NameIn(APPROACHES)] = Field(
        "leader_following", description=f"How the members keep their places: {', '.join(APPROACHES)}."
    )
    options: dict[str, Any] = Field(
        {},
        description="Parameters of the approach, by name. Default: the approach's own values.",
        json_schema_extra=_with_options_of_each_approach,
    )
    shape: Shape = Field(Shape(), description="The shape of the group.")
    narrow_shape: Shape | None = Field(
        None, description="Shape for passages where `shape` does not fit, or costs more. Default: none."
    )
    exposure: Literal["sum", "survival"] = Field(
        "sum",
        description="Exposure of a group in its planner. sum: the sum of P_s over the members' cells. "
        "survival: 1 − ∏(1 − P_s).",
    )
    split_factor: float | None = Field(
        None,
        ge=1.0,
        le=100.0,
        description="Price of flying apart, 1 or more. The group splits and meets again if the members' own "
        "routes, times this factor, and the group's route from there on cost less than its route together. "
        "Default: the group never splits.",
    )
    heights: Literal["stepped", "level"] = Field(
        "stepped",
        description="stepped: each member flies at its own altitude. level: at the leader's altitude, with "
        "the shape's height_step_m from place to place.",
    )
    speed_m_s: float | None = Field(
        None,
        gt=0.0,
        description="Speed of the group [m/s]. Members need some more to keep their places in turns. "
        "Default: 0.7 of the slowest member's speed.",
    )
    rate_hz: float = Field(
        5.0,
        ge=5.0,
        le=10.0,
        description="Rate of the vehicle's positions, of the set-points and of the leader's messages [Hz]; "
        "other members tell 2 to 5 times a second.",
    )
    lost_member: Literal["close_up", "leave_open"] = Field(
        "close_up", description="close_up: the others take over its place. leave_open: its place stays open."
    )
    lost_after_s: float = Field(
        2.0, gt=0.0, description="Silence after which a member counts as absent, and another may lead [s]."
    )
    alone_after_s: float = Field(
        10.0,
        gt=0.0,
        description="Time without any other member after which a member flies its own mission [s].",
    )
    max_error_m: float = Field(
        30.0,
        gt=0.0,
        description="Distance from its place above which a member that comes no nearer leaves the group [m].",
    )
    max_error_s: float = Field(
        15.0, gt=0.0, description="Time after which such a member leaves, and flies its own mission [s]."
    )

    @field_validator("options")
    @classmethod
    def _fit_the_approach(cls, options: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if (name := info.data.get("approach")) is None:
            return options
        params = APPROACHES[name].Params
        if unknown := sorted(options.keys() - params.model_fields.keys()):
            known = ", ".join(params.model_fields)
            raise ValueError(f"{name} has no option {', '.join(unknown)}; its options are {known}")
        params(**options)
        return options
