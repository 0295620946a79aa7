"""The section `preflight` of a configuration: conditions for arming."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from swarmctl.core.section import Section

MAX_LOST_LINK_S = 120


class Policy(Section):
    """Declared reactions of the autopilots. Other parameters fail preflight if `set_parameters` is false."""

    lost_link: Literal["return", "land", "hold", "continue"] = Field(
        "continue",
        description="Reaction to missing heartbeats of the ground station. continue: the vehicle flies its "
        "mission to the end.",
    )
    lost_link_after_s: int = Field(
        10,
        ge=5,
        le=MAX_LOST_LINK_S,
        description="Time without a heartbeat until the reaction to a lost link, by the vehicle's clock [s]. "
        "No effect with continue.",
    )
    low_battery: Literal["return", "land"] = Field("return", description="Reaction to a low battery.")
    fence_breach: Literal["return", "land", "hold"] = Field(
        "return", description="Reaction to a breach of the fence."
    )


class Corner(Section):
    """A corner of the fence."""

    lat_deg: float = Field(ge=-89.0, le=89.0, description="Latitude of the corner, WGS 84 [deg].")
    lon_deg: float = Field(ge=-180.0, le=180.0, description="Longitude of the corner, WGS 84 [deg].")


class FenceSection(Section):
    """The fence around all vehicles, uploaded to each vehicle before arming."""

    margin_m: float = Field(
        50.0,
        gt=0.0,
        le=5000.0,
        description="Distance of the default polygon from the area, the starts and the landing patterns of "
        "planes, and of the default ceiling from the highest altitude [m].",
    )
    max_altitude_m: float | None = Field(
        None,
        gt=2.0,
        le=5000.0,
        description="Ceiling above home [m]. Default: the highest vehicle's altitude plus margin_m.",
    )
    polygon: tuple[Corner, ...] | None = Field(
        None,
        min_length=3,
        max_length=60,
        description="Corners of the fence, in order. Default: margin_m around area, starts and landings.",
    )


class PreflightSection(Section):
    """Checks of every vehicle before arming. `swarmctl preflight` runs the checks without arming."""

    policy: Policy = Field(Policy(), description="Declared failsafe reactions of the autopilots.")
    reserve_percent: float = Field(
        20.0,
        ge=0.0,
        lt=100.0,
        description="Battery charge that must remain after the route and the return [%].",
    )
    endurance_s: float | None = Field(
        None,
        gt=0.0,
        description="Flight time of a full battery [s]. Default: unknown, so that real vehicles fail the "
        "check `battery`; vehicles of the built-in simulator have a known endurance.",
    )
    clock_tolerance_s: float = Field(
        2.0,
        gt=0.0,
        description="Greatest difference of a vehicle's clock from the ground station's [s]; for simulated "
        "vehicles times the speedup, and in real time from the median of their clocks.",
    )
    fence: FenceSection = Field(FenceSection(), description="The fence around all vehicles.")
    set_parameters: bool = Field(
        False,
        description="true: a flight writes required parameters to the vehicles permanently. false: only "
        "a comparison.",
    )
