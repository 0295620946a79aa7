"""Whole flights on the virtual clock in which something goes wrong with a simulated vehicle."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, fly, small
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet, Truth
from swarmctl.config.scenario import Scenario
from swarmctl.flight import virtual_simulator
from swarmctl.flight.virtual_simulator import AddressOf, undisturbed
from swarmctl.report.outcome import Report

OTHER_STATION = 200
MODES = {"LOITER": 5, "RTL": 6, "GUIDED": 4, "LAND": 9, "AUTO": 3}
"""ArduCopter's"""


@dataclass
class Trouble:
    """What the simulator is told besides, and what others do meanwhile. Times are of the run's clock [s]."""

    faults: list[dict[str, Any]] = field(default_factory=list)
    wind: dict[str, float] | None = None
    params: dict[str, float] = field(default_factory=dict)
    deeds: list[tuple[float, Callable[[Fleet], None]]] = field(default_factory=list)
    modes: dict[int, list[str]] = field(default_factory=dict)
    """by vehicle: the modes it has flown in, in order"""
    note: Callable[[float, Truth], None] = lambda _now, _truth: None
    """looks on, several times a second"""

    def told(self, content: dict[str, Any]) -> dict[str, Any]:
        for vehicle in content["vehicles"]:
            vehicle["params"] |= self.params
        more: dict[str, Any] = {"faults": self.faults}
        if self.wind is not None:
            more["wind"] = self.wind
        return {**content, **more}

    def watch(self, fleet: Fleet) -> None:
        now = asyncio.get_running_loop().time()
        self.note(now, fleet.truth())
        while self.deeds and now >= self.deeds[0][0]:
            self.deeds.pop(0)[1](fleet)
        truth = fleet.truth()
        for sysid, mode, armed in zip(truth.sysid, truth.mode, truth.armed, strict=True):
            modes = self.modes.setdefault(int(sysid), [])
            if armed and (not modes or modes[-1] != mode):
                modes.append(mode)


def chooses(sysid: int, mode: str) -> Callable[[Fleet], None]:
    """Somebody else puts a vehicle in a mode: another ground station, as a pilot's switch does."""

    def deed(fleet: Fleet) -> None:
        station = mavlink.MAVLink(None, OTHER_STATION, 190)
        enabled = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        message = station.set_mode_encode(sysid, enabled, MODES[mode])
        now = asyncio.get_running_loop().time()
        fleet.receive(message.pack(station), now, peer="another station")

    return deed


def play(trouble: Trouble, monkeypatch: pytest.MonkeyPatch) -> None:
    """From here on the simulator of every flight has this trouble."""
    told = virtual_simulator.scenario_json

    class Watched(Fleet):
        def step(self, now: float) -> Any:
            frames = super().step(now)
            trouble.watch(self)
            return frames

    monkeypatch.setattr(virtual_simulator, "scenario_json", lambda scenario: trouble.told(told(scenario)))
    monkeypatch.setattr(virtual_simulator, "Fleet", Watched)


def suffer(
    trouble: Trouble,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    scenario: Scenario | None = None,
    carry: AddressOf = undisturbed,
) -> tuple[Report, Ui]:
    """Fly with this trouble."""
    play(trouble, monkeypatch)
    ui = Ui()
    return fly(scenario or small(), folder, carry=carry, ui=ui), ui
