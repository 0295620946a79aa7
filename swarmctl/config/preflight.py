"""What has to be true of every vehicle before it is armed."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarmctl.core.section import Section


class Policy(Section):
    """What a vehicle does by itself; its own parameters must say the same, or it is not armed."""

    lost_link: Literal["return", "land", "hold", "continue"] = Field(
        "continue",
        description="when the ground station's heartbeats stay away; continue: its mission, to the end",
    )
    lost_link_after_s: int = Field(
        10, ge=5, le=120, description="without a heartbeat, by the vehicle's clock [s]; not with continue"
    )
    low_battery: Literal["return", "land"] = "return"
    fence_breach: Literal["return", "land", "hold"] = "return"


class Corner(Section):
    lat_deg: float = Field(ge=-89.0, le=89.0)
    lon_deg: float = Field(ge=-180.0, le=180.0)


class FenceSection(Section):
    """What all vehicles stay inside of; uploaded to each before it is armed."""

    margin_m: float = Field(
        50.0, gt=0.0, le=5000.0, description="around the area and the starts, where no polygon is given [m]"
    )
    max_altitude_m: float | None = Field(
        None, gt=2.0, le=5000.0, description="above home [m]; default: the highest vehicle's, and margin_m"
    )
    polygon: tuple[Corner, ...] | None = Field(
        None, min_length=3, max_length=60, description="its corners in order; default: as margin_m says"
    )


class PreflightSection(Section):
    """Checks without which nothing is armed; `swarmctl preflight` makes them alone."""

    policy: Policy = Policy()
    reserve_percent: float = Field(
        20.0, ge=0.0, lt=100.0, description="of the battery left after the route and the way back"
    )
    endurance_s: float | None = Field(
        None,
        gt=0.0,
        description="what a full battery flies [s]; vehicles of the built-in simulator have one of their own",
    )
    clock_tolerance_s: float = Field(
        2.0, gt=0.0, description="how far a vehicle's clock may be from the ground station's [s]"
    )
    fence: FenceSection = FenceSection()
    set_parameters: bool = Field(
        False, description="whether what the policy asks for is written to the vehicles; false: compared only"
    )
