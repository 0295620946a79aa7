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
        description="Time ahead in which flights are compared, for the alarm and for a stop in time [s].",
    )
    action: Literal["hold", "climb", "none"] = Field(
        "hold",
        description="Reaction to a conflict within look_ahead_s, by the rule of priority. hold: a copter "
        "stops until its way is clear, a fixed wing climbs. climb: a climb, and a stop at the last moment "
        "if that is not enough. none: only the alarm.",
    )
