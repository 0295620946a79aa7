"""Troubles of the simulated vehicles of a flight on the virtual clock, and of its operator."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet
from sim_vehicle.truth import Truth
from swarmctl.config.scenario import Scenario
from swarmctl.flight import virtual_simulator
from swarmctl.flight.simulator import scenario_json
from swarmctl.flight.virtual_clock import VirtualTimeLoop
from swarmctl.flight.virtual_simulator import Frames
from swarmctl.links.transports.memory import MemoryWire

OTHER_STATION = 200
MODES = {"LOITER": 5, "RTL": 6, "GUIDED": 4, "LAND": 9, "AUTO": 3}
"""ArduCopter's"""


@dataclass
class Trouble:
    """Faults, wind and parameters of the simulator, and actions of other stations, by the run's clock [s].

    `simulate` is the simulator of a flight with all of these.
    """

    faults: list[dict[str, Any] | str] = field(default_factory=list)
    """as in a scenario's file, or as on the simulator's command line"""
    wind: dict[str, float] | None = None
    params: dict[str, float] = field(default_factory=dict)
    """parameters of every vehicle"""
    params_of: dict[int, dict[str, float]] = field(default_factory=dict)
    """parameters of single vehicles, by system id"""
    actions: list[tuple[float, Callable[[Fleet], None]]] = field(default_factory=list)
    """actions still to come with their times, in any order"""
    modes: dict[int, list[str]] = field(default_factory=dict)
    """modes in which each armed vehicle was, in order, by system id"""
    on_step: Callable[[float, Truth], None] = lambda _now, _truth: None
    """called several times a second"""
    loses: Callable[[Fleet, bytes], bool] = lambda _fleet, _frame: False
    """frames from the vehicles that do not arrive (MAVLink 2)"""

    async def simulate(self, wire: MemoryWire, scenario: Scenario) -> None:
        await virtual_simulator.serve(wire, Watched(self.fleet_of(scenario), self))

    def fleet_of(self, scenario: Scenario) -> Fleet:
        content = scenario_json(scenario) | {"faults": self.faults}
        for vehicle in content["vehicles"]:
            vehicle["params"] |= self.params | self.params_of.get(vehicle["sysid"], {})
        if self.wind is not None:
            content["wind"] = self.wind
        return virtual_simulator.fleet_of(scenario, content)

    def watch(self, fleet: Fleet) -> None:
        now, truth = asyncio.get_running_loop().time(), fleet.truth()
        self.on_step(now, truth)
        self.actions.sort(key=lambda timed: timed[0])
        while self.actions and now >= self.actions[0][0]:
            self.actions.pop(0)[1](fleet)
        for sysid, mode, armed in zip(truth.sysid, truth.mode, truth.armed, strict=True):
            modes = self.modes.setdefault(int(sysid), [])
            if armed and (not modes or modes[-1] != mode):
                modes.append(mode)


def sagging(share: float) -> Trouble:
    """Return a fault that limits the second vehicle's charge to this share after 30 s."""
    params = {"at_most": share, "sag_v": 0.0}
    return Trouble(faults=[{"fault": "battery_sag", "params": params, "vehicles": [2], "at_s": 30.0}])


def outage(for_s: float | None = None, *, at_s: float = 30.0) -> Trouble:
    """Return a lost link of the second vehicle, by default after 30 s and for ever."""
    lasts = {} if for_s is None else {"for_s": for_s}
    return Trouble(faults=[{"fault": "link_outage", "vehicles": [2], "at_s": at_s, **lasts}])


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


class Watched:
    """A fleet that a trouble meets at every step."""

    def __init__(self, fleet: Fleet, trouble: Trouble) -> None:
        self.sysids = fleet.sysids
        self._fleet, self._trouble = fleet, trouble

    def step(self, now: float) -> Frames:
        frames = self._fleet.step(now)
        self._trouble.watch(self._fleet)
        return self._arriving(frames)

    def receive(self, data: bytes, now: float, **more: Any) -> Frames:
        return self._arriving(self._fleet.receive(data, now, **more))

    def _arriving(self, frames: Frames) -> Frames:
        return [(index, frame) for index, frame in frames if not self._trouble.loses(self._fleet, frame)]


def interrupting(*times_s: float) -> Trouble:
    """Return an operator who presses Ctrl-C at these times."""
    return Trouble(actions=[(at_s, lambda _fleet: signal.raise_signal(signal.SIGINT)) for at_s in times_s])


def interrupts(monkeypatch: pytest.MonkeyPatch) -> list[Callable[[], None]]:
    """Return a list to which each following flight appends its Ctrl-C, as a function.

    One process has one handler of signals, and a test may have several flights.
    """
    pressed: list[Callable[[], None]] = []

    def add_signal_handler(_loop: object, number: int, handler: Callable[[], None]) -> None:
        if number == signal.SIGINT:
            pressed.append(handler)

    monkeypatch.setattr(VirtualTimeLoop, "add_signal_handler", add_signal_handler)
    return pressed
