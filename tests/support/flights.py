"""Small swarms on the virtual clock, for tests."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trouble import Trouble

from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.config.model import Config
from swarmctl.config.scenario import Scenario, build
from swarmctl.core.geo import distance_m
from swarmctl.core.messages import Request
from swarmctl.core.mission import Waypoint
from swarmctl.core.records import replace
from swarmctl.flight import app
from swarmctl.flight.run import DEFAULT_OPTIONS, FlightOptions
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.preflight.waivers import Waiver
from swarmctl.report import outputs
from swarmctl.report.live_rows import SwarmView
from swarmctl.report.outcome import FlightReport
from swarmctl.station import client, commands
from swarmctl.station.commands import Answers


@dataclass
class Ui:
    """A user interface that keeps everything it shows."""

    said: list[str] = field(default_factory=list)
    logged: list[str] = field(default_factory=list)
    views: list[SwarmView] = field(default_factory=list)

    def say(self, text: str) -> None:
        self.said.append(text)

    def log(self, text: str) -> None:
        self.logged.append(text)

    def refresh(self, view: SwarmView) -> None:
        self.views.append(view)


@dataclass
class FaultyUi(Ui):
    """A user interface that fails after a time in flight [s]."""

    error: BaseException = field(default_factory=lambda: RuntimeError("a bug"))
    after_s: float = 20.0

    def refresh(self, view: SwarmView) -> None:
        super().refresh(view)
        if view.flown_s > self.after_s:
            raise self.error


STATION = client.FlightEndpoints("small", BusEndpoint("127.0.0.1", 7447))
"""the operator's address of a flight with all vehicles in one process, on a bus in memory"""
SEPARATION_WAIVED = FlightOptions(waivers=(Waiver("separation"),))
"""The preflight check is waived; in flight the vehicles still keep their separation."""
AREA = {"origin_lat_deg": 46.0, "origin_lon_deg": 14.4, "rows": 8, "cols": 8, "cell_size_m": 50.0}


def coded(lines: list[str], vehicle: str, code: str) -> list[str]:
    """Return the messages of a vehicle that end in a code."""
    return [line for line in lines if line.startswith(f"{vehicle}:") and line.endswith(f"[{code}]")]


def small_config(**sections: object) -> Config:
    """Return a configuration of three copters over 8 × 8 cells with 5 hostiles, changed by `sections`."""
    content: dict[str, object] = {
        "name": "small",
        "seed": 3,
        "area": AREA,
        "threats": {"count": 5},
        "communication": {"bus": "memory"},
        "flight": {
            "altitude_m": 15.0
        },  # the climb to the usual 40 m and the descent are a quarter of the work
        "simulate": {"count": 3, "ready_s": 3.0},
    }
    return Config.model_validate_json(json.dumps({**content, **sections}))


def small(**sections: object) -> Scenario:
    return build(small_config(**sections))


def virtual_flight(
    scenario: Scenario,
    folder: Path,
    ui: Ui | None = None,
    *,
    bus: Transport | None = None,
    options: FlightOptions = DEFAULT_OPTIONS,
) -> Coroutine[Any, Any, FlightReport]:
    """Return a flight for the virtual clock, with its records in an existing folder."""
    return app.fly(
        scenario,
        folder,
        ui or Ui(),
        clock="virtual",
        permission=lambda foreign: None,
        bus=bus,
        options=options,
    )


def fly(
    scenario: Scenario,
    folder: Path,
    *,
    trouble: Trouble | None = None,
    ui: Ui | None = None,
    broken: bool = False,
    options: FlightOptions = DEFAULT_OPTIONS,
    bus: Transport | None = None,
    beside: Callable[[], Awaitable[None]] | None = None,
) -> FlightReport:
    """Fly on the virtual clock and write the run folder; raise a bug unless `broken` is set.

    `beside`: actions of an operator, from the start of the flight on.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if trouble is not None:
        options = replace(options, simulate=trouble.simulate)

    async def scene() -> FlightReport:
        flight = asyncio.create_task(virtual_flight(scenario, folder, ui, bus=bus, options=options))
        if beside is not None:
            await beside()
        return await flight

    report = run_virtual(scene())
    if report.bug is not None and not broken:
        raise report.bug
    outputs.write_run(folder, scenario, report)
    return report


def fly_with_commands(
    scenario: Scenario,
    folder: Path,
    *given: tuple[float, Request],
    trouble: Trouble | None = None,
    ui: Ui | None = None,
) -> tuple[FlightReport, list[Answers]]:
    """Fly as `fly` does; an operator gives commands at these times [s], in order. Return the answers too."""
    bus = MemoryBus()
    answers: list[Answers] = []

    async def operate() -> None:
        for at_s, command in given:
            await asyncio.sleep(at_s - asyncio.get_running_loop().time())
            answers.append(await commands.ask(bus, STATION, command))

    return fly(scenario, folder, trouble=trouble, ui=ui, bus=bus, beside=operate), answers


def winged_config(**sections: Any) -> Config:
    """Return a configuration of a fixed wing and a copter over 12 × 12 cells, changed by `sections`."""
    content: dict[str, dict[str, Any]] = {
        "area": {**AREA, "rows": 12, "cols": 12},
        "flight": {"altitude_m": 30.0, "any_angle": True},
        "simulate": {
            "count": 2,
            "ready_s": 3.0,
            "autopilot": ["arduplane", "ardupilot"],
            "start_distance_m": 150.0,
        },
    }
    content = {key: section | sections.pop(key, {}) for key, section in content.items()}
    return small_config(**content, **sections)


def winged(**sections: Any) -> Scenario:
    return build(winged_config(**sections))


def away_m(report: FlightReport, uav: int, place: Waypoint | tuple[float, float]) -> float:
    """Return the final distance of a vehicle from a place."""
    vehicle = report.states[uav].vehicle
    assert vehicle.lat_deg is not None
    assert vehicle.lon_deg is not None
    there = (place.lat_deg, place.lon_deg) if isinstance(place, Waypoint) else place
    return distance_m((vehicle.lat_deg, vehicle.lon_deg), there)
