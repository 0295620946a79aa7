"""The return queue of vehicles in several processes, to which no process assigns turns."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from companion_world import NAMES, Swarm
from flights import small
from recall_stories import ReturnMonitor, gathering
from trouble import Trouble, inject

from sim_vehicle.truth import Truth
from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.return_schedule import MIN_HORIZONTAL_M, MIN_SILENCE_S
from swarmctl.config.scenario import Scenario
from swarmctl.core.frames import StateShared
from swarmctl.core.geo import LatLon
from swarmctl.core.messages import VehiclePosition
from swarmctl.flight import task_tree
from swarmctl.flight.return_queue import SLOT_S, ReturnQueue
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.outcome import FlightReport

HOME = (46.0, 14.4)
OWN = VehiclePosition(46.005, 14.4, 340.0, *HOME, 300.0, speed_m_s=10.0, min_separation_m=(20.0, 5.0))
"""556 m north of its home"""


def state(
    time_s: float, phase: Phase, *, lat_deg: float = 46.004, lon_deg: float = 14.4, home: LatLon = HOME
) -> StateShared:
    returns_to = home if phase is Phase.LEAVING else None
    return StateShared(time_s, lat_deg, lon_deg, 45.0, phase, 0, 0, alt_amsl_m=345.0, returns_to=returns_to)


class Peers:
    """A vehicle's queue and the states that it has received."""

    def __init__(self, uav: int = 2) -> None:
        self.states: dict[int, StateShared] = {}
        self.turns = ReturnQueue(uav, lambda: self.states)

    def may_return(self, now_s: float) -> bool:
        return self.turns.may_return(OWN, now_s)


def test_a_vehicle_alone_returns_at_once() -> None:
    assert Peers().may_return(0.0)


def test_a_vehicle_waits_until_another_on_its_return_path_has_landed() -> None:
    peers = Peers()
    for second in range(60):
        peers.states[3] = state(second, Phase.LEAVING)
        assert not peers.may_return(float(second))
    peers.states[3] = state(61.0, Phase.DONE)
    assert peers.may_return(61.0)


def test_a_vehicle_does_not_wait_for_a_return_path_that_does_not_meet_its_own() -> None:
    peers = Peers()
    peers.states[3] = state(0.0, Phase.LEAVING, lon_deg=14.42, home=(46.0, 14.42))
    assert peers.may_return(0.0)


@pytest.mark.parametrize("phase", [Phase.HOLDING, Phase.FLYING])
def test_the_lower_system_id_of_two_waiting_vehicles_returns_first(phase: Phase) -> None:
    """A vehicle reports its hold a moment after it begins."""
    peers = Peers()
    for tenth in range(int(10.0 * SLOT_S)):
        peers.states[1] = state(0.1 * tenth, phase)
        assert not peers.may_return(0.1 * tenth)
    lower = Peers(1)
    lower.states[2] = state(0.0, Phase.HOLDING)
    assert lower.may_return(0.0)


def test_a_vehicle_that_keeps_holding_does_not_block_the_queue() -> None:
    peers = Peers()
    peers.states[1] = state(0.0, Phase.HOLDING)
    assert not peers.may_return(0.0)
    peers.states[1] = state(SLOT_S, Phase.HOLDING)
    assert peers.may_return(SLOT_S)


def test_a_silent_returning_vehicle_counts_until_it_must_be_down() -> None:
    peers = Peers()
    peers.states[3] = state(0.0, Phase.LEAVING)
    # 10 s to react, 10 to climb to 60 m, 445 m at half its speed, 75 to come down.
    assert not peers.may_return(0.0)
    assert not peers.may_return(180.0)
    assert peers.may_return(190.0)


def test_a_silent_holding_vehicle_does_not_block_the_queue() -> None:
    peers = Peers()
    peers.states[1] = state(0.0, Phase.HOLDING)
    assert not peers.may_return(0.0)
    assert peers.may_return(MIN_SILENCE_S + 1.0)


def lands(**changes: Any) -> bool:
    """Return whether vehicle 2, 40 m above home, may land with this state of vehicle 3."""
    peers = Peers()
    fields: dict[str, Any] = {"lat_deg": OWN.lat_deg, "lon_deg": OWN.lon_deg, "alt_amsl_m": 330.0, **changes}
    peers.states[3] = msgspec.structs.replace(state(0.0, Phase.HOLDING), **fields)
    return peers.turns.may_land(OWN, 0.0)


@pytest.mark.parametrize(
    ("changes", "may"),
    [
        ({}, False),
        ({"phase": "leaving", "alt_amsl_m": 302.0, "alt_rel_m": 2.0}, False),
        ({"alt_rel_m": 0.1}, True),
        ({"lat_deg": OWN.lat_deg + 0.0002}, True),
        ({"alt_amsl_m": 350.0}, True),
        ({"alt_amsl_m": 340.0}, True),
    ],
    ids=["below", "below and descending", "on the ground", "22 m away", "above", "at equal height"],
)
def test_a_vehicle_does_not_land_on_a_vehicle_of_another_process(
    changes: dict[str, Any], *, may: bool
) -> None:
    assert lands(**changes) is may


def test_the_lower_system_id_lands_first_at_equal_heights() -> None:
    peers = Peers()
    peers.states[1] = msgspec.structs.replace(
        state(0.0, Phase.HOLDING), lat_deg=OWN.lat_deg, alt_amsl_m=OWN.alt_amsl_m
    )
    assert not peers.turns.may_land(OWN, 0.0)


def test_a_silent_vehicle_below_blocks_the_landing_until_it_must_be_down() -> None:
    peers = Peers()
    peers.states[3] = msgspec.structs.replace(
        state(0.0, Phase.LEAVING), lat_deg=OWN.lat_deg, alt_amsl_m=330.0
    )
    assert not peers.turns.may_land(OWN, 0.0)
    assert not peers.turns.may_land(OWN, 55.0)
    assert peers.turns.may_land(OWN, 57.0)  # 45 m at 0.8 m/s


def pressing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scenario: Scenario, at_s: float
) -> list[FlightReport]:
    """Fly several agents and press Ctrl-C on each at the same time."""
    pressed: list[Callable[[], None]] = []

    @contextlib.contextmanager
    def signals(interrupted: Callable[[], None]) -> Iterator[None]:
        pressed.append(interrupted)
        yield

    # One process has one handler of signals.
    monkeypatch.setattr(task_tree, "_signals", signals)

    async def scene() -> list[FlightReport]:
        swarm = Swarm(tmp_path, scenario)
        uavs = [uav for uav in NAMES if any(spec.sysid == uav for spec in scenario.specs)]
        for uav in uavs:
            swarm.start(uav, "when-ready")
        for uav in uavs:
            await swarm.until(uav, Phase.FLYING)
        await asyncio.sleep(at_s)
        for press in pressed:
            press()
        return list(await asyncio.gather(*swarm.flights.values()))

    reports: list[FlightReport] = run_virtual(scene())
    assert [report.ended for report in reports] == ["stopped"] * len(reports)
    assert not any(s.vehicle.armed for report in reports for s in report.states.values())
    return reports


@pytest.mark.virtual
def test_ctrl_c_of_several_agents_returns_them_in_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monitor = ReturnMonitor()
    inject(Trouble(on_step=monitor), monkeypatch)
    pressing(tmp_path, monkeypatch, gathering(), 38.0)
    assert len({round(at_s) for at_s in monitor.since_s.values()}) > 1
    assert monitor.least_m > MIN_HORIZONTAL_M


@pytest.mark.full
@pytest.mark.virtual
def test_ctrl_c_of_several_agents_lands_the_upper_vehicle_when_the_lower_one_is_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = small(
        simulate={"count": 2, "goal": [4, 7], "ready_s": 3.0},
        threats={"count": 0},
        flight={"altitude_m": 15.0, "altitude_step_m": 6.0, "on_exit": "land", "on_exit_deadline_s": 200.0},
    )
    down_s: dict[int, float] = {}

    def note(now: float, truth: Truth) -> None:
        for sysid, armed in zip(truth.sysid, truth.armed, strict=True):
            if armed:
                down_s[int(sysid)] = now

    inject(Trouble(on_step=note), monkeypatch)
    pressing(tmp_path, monkeypatch, scenario, 60.0)
    assert down_s[2] - down_s[1] > 20.0  # the descent is 21 m, and the last 10 m take 20 s
