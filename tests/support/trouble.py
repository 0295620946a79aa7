"""Whole flights on the virtual clock with faults of a simulated vehicle."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, fly, small
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet
from sim_vehicle.truth import Truth
from swarmctl.config.scenario import Scenario
from swarmctl.flight import virtual_simulator
from swarmctl.flight.simulator import AddressOf, undisturbed
from swarmctl.report.outcome import FlightReport

Frames = list[tuple[int, bytes]]
OTHER_STATION = 200
MODES = {"LOITER": 5, "RTL": 6, "GUIDED": 4, "LAND": 9, "AUTO": 3}
"""ArduCopter's"""


@dataclass
class Trouble:
    """Faults, wind and parameters of the simulator, and actions of other stations, by the run's clock [s]."""

    faults: list[dict[str, Any] | str] = field(default_factory=list)
    """as in a scenario's file, or as on the simulator's command line"""
    wind: dict[str, float] | None = None
    params: dict[str, float] = field(default_factory=dict)
    """parameters of every vehicle"""
    params_of: dict[int, dict[str, float]] = field(default_factory=dict)
    """parameters of single vehicles, by system id"""
    actions: list[tuple[float, Callable[[Fleet], None]]] = field(default_factory=list)
    modes: dict[int, list[str]] = field(default_factory=dict)
    """modes in which each armed vehicle was, in order, by system id"""
    on_step: Callable[[float, Truth], None] = lambda _now, _truth: None
    """called several times a second"""
    loses: Callable[[Fleet, bytes], bool] = lambda _fleet, _frame: False
    """frames from the vehicles that do not arrive (MAVLink 2)"""

    def added_to(self, content: dict[str, Any]) -> dict[str, Any]:
        for vehicle in content["vehicles"]:
            vehicle["params"] |= self.params | self.params_of.get(vehicle["sysid"], {})
        more: dict[str, Any] = {"faults": self.faults}
        if self.wind is not None:
            more["wind"] = self.wind
        return {**content, **more}

    def watch(self, fleet: Fleet) -> None:
        now = asyncio.get_running_loop().time()
        self.on_step(now, fleet.truth())
        while self.actions and now >= self.actions[0][0]:
            self.actions.pop(0)[1](fleet)
        truth = fleet.truth()
        for sysid, mode, armed in zip(truth.sysid, truth.mode, truth.armed, strict=True):
            modes = self.modes.setdefault(int(sysid), [])
            if armed and (not modes or modes[-1] != mode):
                modes.append(mode)


def sagging(share: float) -> Trouble:
    """Return a fault that limits the second vehicle's charge to this share after 30 s."""
    params = {"at_most": share, "sag_v": 0.0}
    return Trouble(faults=[{"fault": "battery_sag", "params": params, "vehicles": [2], "at_s": 30.0}])


def outage(for_s: float) -> Trouble:
    """Return a lost link of the second vehicle after 30 s."""
    return Trouble(faults=[{"fault": "link_outage", "vehicles": [2], "at_s": 30.0, "for_s": for_s}])


def another_station_sends(fleet: Fleet, message: mavlink.MAVLink_message, now: float | None = None) -> None:
    """Deliver another station's message; `now` is the loop's time unless given."""
    at_s = asyncio.get_running_loop().time() if now is None else now
    station = mavlink.MAVLink(None, OTHER_STATION, 190)
    fleet.receive(message.pack(station), at_s, peer="another station")


def mode_message(sysid: int, number: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_set_mode_message(sysid, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, number)


def select_mode(sysid: int, mode: str) -> Callable[[Fleet], None]:
    """Return an action of another station that selects a mode, as a pilot's switch does."""
    return lambda fleet: another_station_sends(fleet, mode_message(sysid, MODES[mode]))


def watched(trouble: Trouble) -> type[Fleet]:
    """Return the class of a fleet that this trouble meets at every step."""

    class Watched(Fleet):
        def step(self, now: float) -> Frames:
            frames = super().step(now)
            trouble.watch(self)
            return self._arriving(frames)

        def receive(self, *args: Any, **kwargs: Any) -> Frames:
            return self._arriving(super().receive(*args, **kwargs))

        def _arriving(self, frames: Frames) -> Frames:
            return [(index, frame) for index, frame in frames if not trouble.loses(self, frame)]

    return Watched


def inject(trouble: Trouble, monkeypatch: pytest.MonkeyPatch) -> None:
    """Give this trouble to the simulator of every following flight."""
    scenario_json = virtual_simulator.scenario_json
    monkeypatch.setattr(
        virtual_simulator, "scenario_json", lambda scenario: trouble.added_to(scenario_json(scenario))
    )
    monkeypatch.setattr(virtual_simulator, "Fleet", watched(trouble))


def fly_with(
    trouble: Trouble,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    scenario: Scenario | None = None,
    address_of: AddressOf = undisturbed,
) -> tuple[FlightReport, Ui]:
    """Fly with this trouble."""
    inject(trouble, monkeypatch)
    ui = Ui()
    return fly(scenario or small(), folder, address_of=address_of, ui=ui), ui
