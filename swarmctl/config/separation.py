"""How far vehicles keep from each other: the section `separation` of a configuration."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarmctl.core.section import Section


class SeparationSection(Section):
    """Two vehicles are too close when they are closer than both distances at one time."""

    horizontal_m: float = Field(10.0, gt=0.0, le=1000.0, description="between two vehicles, over ground [m]")
    vertical_m: float = Field(
        3.0,
        gt=0.0,
        le=500.0,
        description="between two vehicles, in height [m]; who is to be kept apart by height flies 1.2 times "
        "as much above or below, because heights are not held to the metre",
    )
    look_ahead_s: float = Field(
        10.0, gt=0.0, le=120.0, description="in flight others are watched for so long ahead [s]"
    )
    action: Literal["hold", "climb", "none"] = Field(
        "hold",
        description="of the vehicle with the higher system id, when two are about to be too close: hold "
        "until they are clear (climb where it would stand in the way), climb, or none but the alarm",
    )
