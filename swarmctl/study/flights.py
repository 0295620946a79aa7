"""The kind `flights`: whole flights on the virtual clock, with simulated vehicles and MAVLink, as columns.

A flight is what `swarmctl fly --clock virtual` flies with the seed of the world. Its rows come from the
content of `summary.json`, so they hold no time of this machine. The files of a flight are removed.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.config.scenario import Scenario, build
from swarmctl.core import exposure as measures
from swarmctl.core.belief import UNKNOWN
from swarmctl.flight import app
from swarmctl.flight.run import real_clock_need
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.formations import AXES
from swarmctl.report.outcome import FlightReport
from swarmctl.report.summary import known_to_any
from swarmctl.report.ui import SilentUi
from swarmctl.study.tables import SeedResult
from swarmctl.study.world import World


class FlightFailed(Exception):
    """A flight that ended by an error. The text has the seed, the cause and the remedy."""


class FlownVehicle(msgspec.Struct, frozen=True):
    """The measures of one vehicle in one flight.

    A measure with the name of one in `VehicleResult` has its meaning. Errors of a vehicle without a place in
    a group, and times of a vehicle that has not arrived, are NaN.
    """

    uav: int
    arrived: bool
    length_m: float
    """distance flown, from take-off to landing [m]"""
    exposure_sum: float
    """ΣP_s of the cells entered by the telemetry, by the true hostiles (Eq. 2)"""
    believed_exposure_sum: float
    """ΣP_s of the first route by the belief at take-off (Eq. 3)"""
    safety_factor: float
    believed_safety_factor: float
    strikes: int
    survived: bool
    searches: int
    replans: int
    messages_sent: int
    """observations sent, counted for each receiver"""
    all_messages_sent: int
    """`messages_sent` of the summary: also states, intents, members' messages and requests"""
    all_messages_received: int
    penalty: float
    flight_time_s: float
    """time from arming to the arrival [s]"""
    arrival_s: float
    """time of the arrival after the first arming of a vehicle [s]"""
    cells_known: int
    cells_own: int
    """cells that the vehicle was the first one to see, as far as it was told"""
    hostiles_known: int
    cells_sensed: int
    """cells seen by any vehicle of the flight"""
    swath_m: float
    """area of these cells, divided by the mean length flown by a vehicle [m]"""
    rms_along_m: float
    """root mean square of the distance from the place in the group, along the way [m]"""
    rms_across_m: float
    rms_height_m: float
    largest_along_m: float
    largest_across_m: float
    largest_height_m: float
    in_group_s: float
    """time with another member present [s]"""
    in_place_s: float
    """time within 5 m of the place [s]"""
    leader_changes: int
    shape_changes: int
    splits: int


def unsupported(scenario: Scenario) -> str | None:
    """Return why a scenario cannot fly on the virtual clock; None if it can."""
    need = real_clock_need(scenario)
    return None if need is None else f"{need}; the kind flights needs simulated vehicles [real-clock]"


def flown(scenario: Scenario, world: World) -> SeedResult[FlownVehicle]:
    """Fly the flight with the seed of a world. Raises FlightFailed."""
    of_seed = build(scenario.config.model_copy(update={"seed": world.seed}))
    report = _fly(of_seed)
    rows = tuple(_rows(of_seed, report, world))
    return SeedResult(rows, tuple(report.states[row.uav].flown.cells for row in rows))


def _fly(scenario: Scenario) -> FlightReport:
    """Fly once, and remove the files. Raises FlightFailed after an error, and RuntimeError after a bug."""
    with tempfile.TemporaryDirectory(prefix="swarmctl-study-") as folder:
        flight = app.fly(scenario, Path(folder), SilentUi(), clock="virtual", permission=lambda _: None)
        report = run_virtual(flight)
    seed = scenario.config.seed
    if report.bug is not None:
        raise RuntimeError(f"the flight with seed {seed} ended by a bug") from report.bug
    if report.ended != "ended":
        text = "; ".join((*report.trouble, *report.final_states))
        raise FlightFailed(
            f"the flight with seed {seed} {report.ended}: {text}; fly it alone by `swarmctl fly --clock "
            "virtual`, or leave out its level [flight-failed]"
        )
    return report


def _rows(scenario: Scenario, report: FlightReport, world: World) -> list[FlownVehicle]:
    """Return the rows of a flight, from the content of its summary."""
    p_s = measures.exposure(world.occupancy(), scenario.strength)
    vehicles = report.summary["vehicles"]
    members = {k: v for group in report.summary["formations"] for k, v in group["members"].items()}
    n_sensed = int(np.count_nonzero(known_to_any(scenario, report.states) != UNKNOWN))
    mean_m = sum(vehicle["flown_m"] for vehicle in vehicles) / len(vehicles)
    armed_s = [s.launch.armed_boot_s for s in report.states.values() if s.launch.armed_boot_s is not None]
    first_s = min(armed_s, default=0.0)
    of_flight: dict[str, Any] = {
        "cells_sensed": n_sensed,
        "swath_m": n_sensed * scenario.grid.cell_size_m**2 / mean_m if mean_m > 0.0 else math.nan,
    }
    return [
        FlownVehicle(
            **_of_vehicle(vehicle, report.states[vehicle["sysid"]], p_s, first_s),
            **_of_member(members.get(vehicle["name"])),
            **of_flight,
        )
        for vehicle in vehicles
    ]


def _of_vehicle(
    vehicle: Mapping[str, Any], state: AgentState, p_s: NDArray[np.float64], first_armed_s: float
) -> dict[str, Any]:
    """Return the measures of a vehicle by its item in the summary; `p_s` is by the true hostiles."""
    first, flown = vehicle["at_takeoff"], np.asarray(state.flown.cells, dtype=np.int64).reshape(-1, 2)
    return {
        "uav": vehicle["sysid"],
        "arrived": state.outcome == ARRIVED,
        "length_m": vehicle["flown_m"],
        "exposure_sum": measures.exposure_sum(p_s, flown),
        "believed_exposure_sum": 0.0 if first is None else first["exposure_sum"],
        "safety_factor": measures.safety_factor(p_s, flown),
        "believed_safety_factor": 1.0 if first is None else first["safety_factor"],
        "strikes": vehicle["strikes"],
        "survived": vehicle["strikes"] == 0,
        "searches": vehicle["searches"],
        "replans": vehicle["replans"],
        "messages_sent": vehicle["network"]["sent"].get("inform/observation", 0),
        "all_messages_sent": vehicle["messages_sent"],
        "all_messages_received": vehicle["network"]["received"],
        "penalty": vehicle["communication_penalty"],
        "flight_time_s": _number(vehicle["arrived_s"]),
        "arrival_s": _number(state.arrived_boot_s) - first_armed_s,
        "cells_known": vehicle["cells_own"] + vehicle["cells_received"],
        "cells_own": vehicle["cells_own"],
        "hostiles_known": vehicle["hostiles_known"],
    }


def _of_member(member: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the measures of a member of a group by its item in the summary; None: a single vehicle."""
    errors = {
        f"{name}_{axis}_m": _number(None if member is None else member[f"{name}_error_m"][axis])
        for name in ("rms", "largest")
        for axis in AXES
    }
    return {
        **errors,
        "in_group_s": 0.0 if member is None else member["time_in_group_s"],
        "in_place_s": 0.0 if member is None else member["time_in_place_s"],
        "leader_changes": 0 if member is None else member["leader_changes"],
        "shape_changes": 0 if member is None else member["shape_changes"],
        "splits": 0 if member is None else member["splits"],
    }


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
