"""The section `separation` of a configuration: least distances, and the reaction to conflicts."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarmctl.core.section import Section


class SeparationSection(Section):
    """The least distances between vehicles, over ground and in height. In a conflict both are smaller."""

    horizontal_m: float = Field(
        10.0, gt=0.0, le=1000.0, description="Least distance between two vehicles over ground [m]."
    )
    vertical_m: float = Field(
        3.0,
        gt=0.0,
        le=500.0,
        description="Least distance between two vehicles in height [m]. Separate altitudes must differ by "
        "1.2 times this value, because vehicles do not hold their height to the metre.",
    )
    look_ahead_s: float = Field(
        10.0,
        gt=0.0,
        le=120.0,
        description="Prediction time of the conflict check in flight [s].",
    )
    action: Literal["hold", "climb", "none"] = Field(
        "hold",
        description="Reaction of the vehicle that gives way in a predicted conflict, usually the vehicle "
        "with the higher system id. hold: a hold until the way is clear; a climb for a fixed wing, or if the "
        "hold would be too close to another vehicle. climb: a climb. none: only the alarm.",
    )
