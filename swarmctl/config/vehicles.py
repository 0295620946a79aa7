"""The sections `simulate` and `vehicles` of a configuration."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from swarmctl.config.autopilots import AUTOPILOTS
from swarmctl.config.links import MavlinkUrl
from swarmctl.config.roster import NamedVehicle, SimulatedCount
from swarmctl.core.grid import Cell
from swarmctl.core.section import NameIn, Section
from swarmctl.core.vehicle import Airframe
from swarmctl.links import LINKS


def _cells(value: Any) -> Any:
    """Return one cell, or a list of cells, as a tuple of cells; any other value unchanged."""
    is_cell = isinstance(value, (list, tuple)) and len(value) == 2 and all(type(v) is int for v in value)
    if is_cell:
        value = (value,)
    if not isinstance(value, (list, tuple)):
        return value
    return tuple(tuple(cell) if isinstance(cell, list) else cell for cell in value)


Cells = Annotated[tuple[Cell, ...], BeforeValidator(_cells), Field(min_length=1)]
Side = Literal["north", "east", "south", "west"]
LinkName = Annotated[str, NameIn(LINKS)]
Autopilot = Annotated[str, NameIn(AUTOPILOTS)]
AutopilotOrMixed = Annotated[str, NameIn((*AUTOPILOTS, "mixed"))]

ARRIVE_WITHIN = "Latest arrival over the goal cell, after the vehicle's take-off [s]. Default: no bound."
ARRIVE_AFTER = "Earliest arrival over the goal cell, after the vehicle's take-off [s]."


class Simulate(SimulatedCount, extra="forbid"):
    """Simulated vehicles along one side of the area. The simulator starts and stops with the flight."""

    speedup: float = Field(
        1.0,
        ge=1.0,
        le=100.0,
        description="Greatest number of simulated seconds in a second of real time; on a busy machine fewer.",
    )
    autopilot: AutopilotOrMixed | Annotated[tuple[Autopilot, ...], Field(min_length=1)] = Field(
        "ardupilot",
        description="Autopilot of the vehicles; arduplane and px4plane are fixed wings. A list is assigned "
        "in turn; mixed is [ardupilot, px4].",
    )
    url: MavlinkUrl = Field(
        "udpin://127.0.0.1:0",
        description="MAVLink URL at which the ground station listens for the vehicles. "
        "Port 0 takes any free port.",
    )
    home_alt_amsl_m: float = Field(
        300.0, ge=-400.0, le=8000.0, description="Height of the ground above mean sea level [m]."
    )
    link: LinkName = Field(
        "direct", description="Link: direct (this program), or mavsdk (MAVSDK, in real time only)."
    )
    ready_s: float = Field(
        5.0,
        ge=0.0,
        description="Time from boot to a position estimate [s]. Real vehicles take about 41 s.",
    )
    speed_m_s: float = Field(10.0, gt=0.5, le=35.0, description="Cruise speed of copters over ground [m/s].")
    start_side: Side = Field("west", description="Side of the area along which the vehicles start.")
    start_distance_m: float = Field(60.0, gt=0.0, description="Distance of the starts from the area [m].")
    start_spacing_m: float | None = Field(
        None,
        gt=0.0,
        description="Distance between neighbouring starts, around the middle of the side [m]. Default: "
        "spread along the whole side.",
    )
    goal_side: Side = Field("east", description="Side of the area along which the goals are spread.")
    goal: Cells | None = Field(
        None,
        description="Goal of all vehicles: a cell [row, col], or a list of cells (a target zone). Default: "
        "cells on goal_side.",
    )
    delay_step_s: float = Field(
        0.0, ge=0.0, description="Launch delay of each vehicle after the previous one [s]."
    )
    arrive_within_s: float | None = Field(None, gt=0.0, description=ARRIVE_WITHIN)
    arrive_after_s: float = Field(0.0, ge=0.0, description=ARRIVE_AFTER)


class Start(Section):
    """Position of a vehicle before take-off."""

    lat_deg: float = Field(ge=-90.0, le=90.0, description="Latitude, WGS 84 [deg].")
    lon_deg: float = Field(ge=-180.0, le=180.0, description="Longitude, WGS 84 [deg].")


class Vehicle(NamedVehicle, extra="forbid"):
    """A vehicle with a MAVLink URL."""

    url: MavlinkUrl = Field(
        description="MAVLink URL of the vehicle: udpin://HOST:PORT, udpout://HOST:PORT, tcpin://HOST:PORT, "
        "tcpout://HOST:PORT or serial:///dev/ttyUSB0:57600. Several vehicles may share a URL."
    )
    link: LinkName = Field("direct", description="Link: direct (this program), or mavsdk (MAVSDK, optional).")
    start: Start = Field(description="Position before take-off, usually outside the area.")
    goal: Cells = Field(description="Goal: a cell [row, col], or a list of cells (a target zone).")
    entry: Cell | None = Field(
        None,
        description="Border cell [row, col] of the entry. Default: nearest to the start, outside no_fly.",
    )
    altitude_m: float | None = Field(
        None,
        gt=2.0,
        le=1000.0,
        description="Flight altitude above home [m]. Default: by flight.altitude_m and altitude_step_m.",
    )
    delay_s: float = Field(0.0, ge=0.0, description="Launch delay [s].")
    airframe: Airframe = Field(
        "copter", description="Kind of vehicle. A vehicle that reports another kind fails preflight."
    )
    turn_radius_m: float = Field(
        0.0,
        ge=0.0,
        description="Turn radius [m]. A value above 0 requires flight.any_angle: true. 0: a copter turns on "
        "the spot, and a plane has wings.turn_radius_m.",
    )
    speed_m_s: float | None = Field(
        None,
        gt=0.5,
        le=35.0,
        description="Speed over ground; a plane's airspeed [m/s]. Required if the vehicle has a time bound, "
        "or the configuration has `arrival`. Default otherwise: 10 m/s (a plane: wings.speed_m_s).",
    )
    arrive_within_s: float | None = Field(None, gt=0.0, description=ARRIVE_WITHIN)
    arrive_after_s: float = Field(0.0, ge=0.0, description=ARRIVE_AFTER)
