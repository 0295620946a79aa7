"""Vehicles of many processes are called back at once, and nobody tells them turns."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from test_abort import NAMES, Looker, Swarm, gathering
from troubled import Trouble, play

from swarmctl import conducting
from swarmctl.agent import Phase
from swarmctl.app import Report
from swarmctl.clock import run_virtual
from swarmctl.core.frames import StateShared
from swarmctl.core.messages import Place
from swarmctl.core.returns import LEAST_APART_M
from swarmctl.taking_turns import SILENT_S, SLOT_S, Turns

HOME = (46.0, 14.4)
OWN = Place(46.005, 14.4, 340.0, *HOME, 300.0, speed_m_s=10.0, keeps_m=(20.0, 5.0))
"""556 m north of its home"""


def state(time_s: float, phase: Phase, *, lat_deg: float = 46.004, lon_deg: float = 14.4) -> StateShared:
    return StateShared(time_s, lat_deg, lon_deg, 45.0, phase, 0, 0, alt_amsl_m=345.0)


class Peers:
    """What a vehicle has heard of the others."""

    def __init__(self, uav: int = 2) -> None:
        self.told: dict[int, StateShared] = {}
        self.turns = Turns(uav, lambda: self.told, {1: HOME, 2: HOME, 3: HOME})

    def may_go(self, now_s: float) -> bool:
        return self.turns.may_go(OWN, now_s)


def test_it_goes_when_nobody_else_is_there() -> None:
    assert Peers().may_go(0.0)


def test_it_holds_while_another_is_on_the_way_that_it_would_take_and_goes_when_that_is_down() -> None:
    peers = Peers()
    for second in range(60):
        peers.told[3] = state(second, Phase.LEAVING)
        assert not peers.may_go(float(second))
    peers.told[3] = state(61.0, Phase.DONE)
    assert peers.may_go(61.0)


def test_whose_way_is_elsewhere_is_not_waited_for() -> None:
    peers = Peers()
    peers.turns = Turns(2, lambda: peers.told, {3: (46.0, 14.42)})
    peers.told[3] = state(0.0, Phase.LEAVING, lon_deg=14.42)
    assert peers.may_go(0.0)


@pytest.mark.parametrize("phase", [Phase.HOLDING, Phase.FLYING])
def test_of_two_that_wait_the_one_with_the_lower_system_id_is_first(phase: Phase) -> None:
    """That it holds is told a moment after it does."""
    peers = Peers()
    for tenth in range(int(10.0 * SLOT_S)):
        peers.told[1] = state(0.1 * tenth, phase)
        assert not peers.may_go(0.1 * tenth)
    lower = Peers(1)
    lower.told[2] = state(0.0, Phase.HOLDING)
    assert lower.may_go(0.0)


def test_one_that_holds_on_is_not_waited_for_for_ever() -> None:
    peers = Peers()
    peers.told[1] = state(0.0, Phase.HOLDING)
    assert not peers.may_go(0.0)
    peers.told[1] = state(SLOT_S, Phase.HOLDING)
    assert peers.may_go(SLOT_S)


def test_one_that_falls_silent_on_its_way_counts_until_it_must_be_down() -> None:
    peers = Peers()
    peers.told[3] = state(0.0, Phase.LEAVING)
    # 10 s to react, 10 to climb to 60 m, 445 m at half its speed, 75 to come down.
    assert not peers.may_go(0.0)
    assert not peers.may_go(180.0)
    assert peers.may_go(190.0)


def test_one_that_fell_silent_while_it_held_is_not_waited_for() -> None:
    peers = Peers()
    peers.told[1] = state(0.0, Phase.HOLDING)
    assert not peers.may_go(0.0)
    assert peers.may_go(SILENT_S + 1.0)


@pytest.mark.virtual
def test_ctrl_c_of_several_agents_brings_them_home_in_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looker = Looker()
    play(Trouble(note=looker), monkeypatch)
    pressed: list[Callable[[], None]] = []

    @contextlib.contextmanager
    def signals(interrupted: Callable[[], None]) -> Iterator[None]:
        pressed.append(interrupted)
        yield

    # One process has one handler of signals.
    monkeypatch.setattr(conducting, "_signals", signals)

    async def scene() -> list[Report]:
        swarm = Swarm(tmp_path, gathering())
        for uav in NAMES:
            swarm.start(uav, "when-ready")
        for uav in NAMES:
            await swarm.until(uav, Phase.FLYING)
        await asyncio.sleep(38.0)
        for press in pressed:
            press()
        return list(await asyncio.gather(*swarm.flights.values()))

    reports: Any = run_virtual(scene())
    assert [report.ended for report in reports] == ["stopped"] * 3
    assert not any(s.vehicle.armed for report in reports for s in report.states.values())
    assert len({round(at_s) for at_s in looker.since_s.values()}) > 1
    assert looker.least_m > LEAST_APART_M
