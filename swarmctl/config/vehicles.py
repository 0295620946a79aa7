"""The vehicles of a configuration: simulated, or reached by a URL."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from swarmctl.config.links import MavlinkUrl
from swarmctl.core.grid import Cell
from swarmctl.core.section import Section
from swarmctl.core.vehicle import Airframe


def _cells(value: Any) -> Any:
    """One cell, or a list of cells."""
    is_cell = isinstance(value, (list, tuple)) and len(value) == 2 and all(type(v) is int for v in value)
    if is_cell:
        value = (value,)
    if not isinstance(value, (list, tuple)):
        return value
    return tuple(tuple(cell) if isinstance(cell, list) else cell for cell in value)


Cells = Annotated[tuple[Cell, ...], BeforeValidator(_cells), Field(min_length=1)]
Side = Literal["north", "east", "south", "west"]
LinkName = Literal["direct", "mavsdk"]
Autopilot = Literal["ardupilot", "px4", "arduplane", "px4plane"]


class Simulate(Section):
    """Vehicles in software, started and stopped with the flight, spread along a side of the area."""

    count: int = Field(ge=1, le=250)
    speedup: float = Field(1.0, ge=1.0, le=100.0, description="simulated seconds in a real one")
    autopilot: Autopilot | Literal["mixed"] | Annotated[tuple[Autopilot, ...], Field(min_length=1)] = Field(
        "ardupilot",
        description="which one they speak like, arduplane and px4plane being fixed wings; a list: by turns; "
        "mixed: ardupilot and px4 by turns",
    )
    url: MavlinkUrl = Field(
        "udpin://127.0.0.1:0", description="where the ground station listens for them; port 0: any free one"
    )
    home_alt_amsl_m: float = Field(300.0, ge=-400.0, le=8000.0, description="of the ground [m]")
    link: LinkName = Field(
        "direct", description="who speaks to them: direct (this program) or mavsdk (real time only)"
    )
    ready_s: float = Field(5.0, ge=0.0, description="from boot to a position estimate [s]; real ones take 41")
    speed_m_s: float = Field(10.0, gt=0.5, le=35.0, description="over ground [m/s]")
    start_side: Side = "west"
    start_distance_m: float = Field(60.0, gt=0.0, description="from the area [m]")
    goal_side: Side = "east"
    goal: Cells | None = Field(None, description="a cell or a zone for all; default: across, on goal_side")
    delay_step_s: float = Field(0.0, ge=0.0, description="each next vehicle starts this much later [s]")
    arrive_within_s: float | None = Field(
        None, gt=0.0, description="time bound: over its goal at most this long after its take-off [s]"
    )
    arrive_after_s: float = Field(
        0.0, ge=0.0, description="arrival window: and not earlier than this after its take-off [s]"
    )


class Start(Section):
    lat_deg: float = Field(ge=-90.0, le=90.0)
    lon_deg: float = Field(ge=-180.0, le=180.0)


class Vehicle(Section):
    """A vehicle reached by its MAVLink URL."""

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]{1,32}$")
    url: MavlinkUrl
    sysid: int = Field(ge=1, le=254)
    link: LinkName = Field(
        "direct", description="who speaks to it: direct (this program) or mavsdk (MAVSDK's stack, optional)"
    )
    start: Start = Field(description="where it stands; usually outside the area")
    goal: Cells = Field(description="a cell [row, col], or a list of cells: its target zone")
    entry: Cell | None = Field(None, description="border cell by which it enters; default: the nearest")
    altitude_m: float | None = Field(None, gt=2.0, le=1000.0, description="above home [m]; default: flight's")
    delay_s: float = Field(0.0, ge=0.0, description="after the others [s]")
    airframe: Airframe = Field(
        "copter", description="what it is; one that tells that it is another is not flown"
    )
    turn_radius_m: float = Field(
        0.0,
        ge=0.0,
        description="of its turns, with flight.any_angle; 0: on the spot, a plane's as wings says [m]",
    )
    speed_m_s: float | None = Field(
        None, gt=0.5, le=35.0, description="what it flies over ground [m/s]; needed with a time bound"
    )
    arrive_within_s: float | None = Field(
        None, gt=0.0, description="time bound: over its goal at most this long after its take-off [s]"
    )
    arrive_after_s: float = Field(
        0.0, ge=0.0, description="arrival window: and not earlier than this after its take-off [s]"
    )
