"""The section `arrival` of a configuration: all vehicles arrive together, or one after the other."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarmctl.core.section import Section


class ArrivalSection(Section):
    """Arrival of all vehicles at their goals, at one time or in order, as early as all vehicles can."""

    mode: Literal["simultaneous", "staggered"] = Field(
        description="simultaneous: all vehicles arrive at one time. staggered: the vehicles arrive in the "
        "order of their system ids, spacing_s apart."
    )
    spacing_s: float | None = Field(
        None,
        gt=0.0,
        le=600.0,
        description="Time between two arrivals [s]. Required if mode is staggered, otherwise not allowed.",
    )
    tolerance_s: float = Field(
        3.0, gt=0.0, description="Greatest deviation from the agreed time that the report accepts [s]."
    )
    slowest_m_s: float = Field(
        0.0,
        ge=0.0,
        description="Lowest commanded speed of a vehicle that would arrive too early [m/s]. The speed is "
        "also at least 1 m/s and at least a fifth of the vehicle's full speed.",
    )

    def model_post_init(self, _context: object) -> None:
        if self.mode == "staggered" and self.spacing_s is None:
            raise ValueError("mode staggered needs spacing_s, the seconds between two arrivals; add it")
        if self.mode == "simultaneous" and self.spacing_s is not None:
            raise ValueError("spacing_s belongs to mode staggered; change the mode, or remove spacing_s")
