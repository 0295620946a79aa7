"""The section `planner` of a configuration."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, ValidationInfo, field_validator

from swarmctl.core.section import NameIn, Section
from swarmctl.planners import PLANNERS, method


class PlannerSection(Section):
    """The choice of routes."""

    name: Annotated[str, NameIn(PLANNERS)] = Field("dijkstra", description=f"Planner: {', '.join(PLANNERS)}.")
    w: float = Field(
        0.5,
        ge=0.0,
        le=1.0,
        description="Weight of exposure against length (Eq. 5). 0: the shortest route; 1: the least exposed.",
    )
    psi_per_cell: float | None = Field(
        None,
        gt=0.0,
        description="Cost of one cell length (Eq. 5). Default: the prior exposure P_s of an inner cell.",
    )
    max_exposure: float | None = Field(
        None, gt=0.0, description="Greatest exposure P_s of a cell on a route. Default: no limit."
    )
    autonomy: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Weight of a vehicle's own observations above those of the others. 0: all weigh the "
        "same; 1: the vehicle ignores the others.",
    )
    benevolence: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        description="Weight of what the others would learn from a route against its own cost. 0: none; 1: an "
        "expected saving of the others counts as much. Planner dijkstra only.",
    )
    options: dict[str, Any] = Field(
        {}, description="Further options of the planner, by name. Default: the planner's own values."
    )

    @field_validator("options")
    @classmethod
    def _known_to_the_planner(cls, options: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if (name := info.data.get("name")) is not None:
            method(name, PLANNERS[name], options)
        return options
