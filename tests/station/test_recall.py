"""Recall of agents on separate machines, with lost answers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.core.messages import (
    GiveOrder,
    VehicleAnswer,
    VehiclePosition,
    decode_command,
    encode,
)
from swarmctl.core.records import replace
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.station import commands
from swarmctl.station.client import TIMEOUT_S, FlightEndpoints
from swarmctl.station.commands import FALLBACK_RETURN_S, MAX_ATTEMPTS

STATION = FlightEndpoints("s", BusEndpoint("127.0.0.1", 7447), agents={1: "a", 2: "b"})


def place(way_deg: float = 0.01) -> VehiclePosition:
    """Return a position `way_deg` of longitude east of its home."""
    return VehiclePosition(
        46.0, 14.0 + way_deg, 340.0, 46.0, 14.0, 300.0, speed_m_s=10.0, min_separation_m=(20.0, 5.0)
    )


@dataclass
class Agents:
    """A network of agents that accept each order, and of answers that may be lost."""

    places: dict[int, VehiclePosition | None]
    answers: Callable[[int, int], bool] = lambda _uav, _times: True
    """True for each delivered answer, by vehicle and number of the question"""
    in_touch: Callable[[int], bool] = lambda _uav: True
    taken: list[tuple[int, Any]] = field(default_factory=list)
    """(uav, after_s) of each order, in their order; after_s None: no recall"""

    async def ask(self, key: str, payload: bytes, timeout_s: float) -> list[bytes]:
        order: Any = decode_command(payload)
        (uav,) = order.uavs
        if not self.in_touch(uav):
            return []
        self.taken.append((uav, order.after_s))
        if not self.answers(uav, sum(1 for other, _ in self.taken if other == uav)):
            await asyncio.sleep(timeout_s)
            raise TimeoutError
        answer = VehicleAnswer(uav, STATION.agents[uav], "taken", place=self.places[uav])
        return [encode(answer)]

    def last(self, uav: int) -> float:
        return [after_s for other, after_s in self.taken if other == uav][-1]


def recalled(agents: Agents, uavs: tuple[int, ...] | None = None) -> dict[int, VehicleAnswer]:
    bus: Any = agents
    answers = run_virtual(commands.ask(bus, STATION, GiveOrder(uavs, "return")))
    return {vehicle.uav: vehicle for vehicle in answers}


def test_a_single_vehicle_waits_by_itself() -> None:
    agents = Agents({1: place(), 2: place()})
    assert list(recalled(agents, (2,))) == [2]
    assert agents.taken == [(2, None)]


def test_a_vehicle_with_a_lost_answer_is_asked_again_and_gets_its_turn() -> None:
    agents = Agents({1: place(), 2: place(0.0102)}, lambda uav, times: uav == 1 or times > 1)
    answers = recalled(agents)
    assert {v.outcome for v in answers.values()} == {"taken"}
    # The rest of the first wait, and then a turn after the nearer vehicle.
    assert [after_s for uav, after_s in agents.taken if uav == 2][:2] == [
        FALLBACK_RETURN_S,
        FALLBACK_RETURN_S - TIMEOUT_S,
    ]
    assert agents.last(1) == 0.0
    assert agents.last(2) > 0.0


def test_no_vehicle_returns_while_an_unconfirmed_one_may() -> None:
    agents = Agents({1: place(), 2: None}, lambda uav, _: uav == 1)
    answers = recalled(agents)
    assert answers[2].outcome == "unconfirmed"
    assert "120 s" in answers[2].note
    assert sum(1 for uav, _ in agents.taken if uav == 2) == MAX_ATTEMPTS
    # 120 s until the return begins, and the return: reaction, climb of 20 m, 773 m at half the speed,
    # 60 m down.
    assert agents.last(1) > FALLBACK_RETURN_S + 10.0 + 20.0 / 1.5 + 773.0 / 5.0 + 60.0 / 0.8


def test_a_vehicle_that_lands_before_the_time_out_returns_at_once() -> None:
    above_home = VehiclePosition(
        46.0, 14.0, 360.0, 46.0, 14.0, 300.0, speed_m_s=10.0, min_separation_m=(20.0, 5.0)
    )
    agents = Agents({1: above_home, 2: None}, lambda uav, _: uav == 1)
    recalled(agents)
    assert agents.last(1) == 0.0


def test_a_vehicle_at_an_unknown_position_waits_as_well() -> None:
    agents = Agents({1: None, 2: None}, lambda uav, _: uav == 1)
    recalled(agents)
    assert agents.last(1) >= 2.0 * FALLBACK_RETURN_S


@pytest.mark.parametrize(
    "changes",
    [
        {"alt_amsl_m": 1e12},
        {"home_alt_amsl_m": -1e300},
        {"speed_m_s": 0.0},
        {"home_lon_deg": 1e300},
        {"min_separation_m": (1e300, 5.0)},
    ],
)
def test_an_impossible_position_counts_as_unknown(
    changes: dict[str, Any],
) -> None:
    agents = Agents({1: place(), 2: replace(place(), **changes)})
    recalled(agents)
    assert agents.last(1) == 0.0
    assert agents.last(2) > 0.0


def test_an_impossible_position_gives_no_duration_of_a_return() -> None:
    agents = Agents({1: replace(place(), speed_m_s=0.0), 2: None}, lambda uav, _: uav == 1)
    recalled(agents)
    assert agents.last(1) >= 2.0 * FALLBACK_RETURN_S


def test_a_vehicle_that_only_height_separates_from_another_says_so() -> None:
    """Vehicle 2 already returns, over vehicle 1, which holds."""
    agents = Agents({1: place(), 2: replace(place(0.02), is_returning=True)})
    answers = recalled(agents)
    assert answers[1].note == ""
    assert answers[2].note == "only height separates its way from a"


def test_a_silent_agent_does_not_delay_the_others() -> None:
    agents = Agents({1: place(), 2: None}, in_touch=lambda uav: uav == 1)
    answers = recalled(agents)
    assert answers[2].outcome == "silent"
    assert agents.last(1) == 0.0


def test_a_turn_with_a_lost_answer_is_sent_again() -> None:
    agents = Agents({1: place(), 2: place(0.0102)}, lambda uav, times: uav == 1 or times != 2)
    answers = recalled(agents)
    assert answers[2].outcome == "taken"
    assert answers[2].note == ""
    turn, again = [after_s for uav, after_s in agents.taken if uav == 2][1:]
    assert again == max(turn - TIMEOUT_S, 0.0)
