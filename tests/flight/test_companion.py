"""Agents that fly one vehicle each, and their operator, together on one virtual clock."""

from __future__ import annotations

import asyncio
import contextlib
import datetime as dt
import json
import time
from pathlib import Path
from typing import Any

import pytest
import typer
from companion_world import NAMES, STATION, Swarm
from flights import Ui, fly_with_commands, small

from swarmctl.agent.given_order import GivenOrder
from swarmctl.agent.launch import Launch
from swarmctl.agent.phases import Phase
from swarmctl.agent.state import ARRIVED
from swarmctl.bus.transports import BUSES, BusKind
from swarmctl.bus.transports.base import Failure
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.cli.flights import conclude
from swarmctl.core.events import FlightOrder
from swarmctl.core.messages import (
    GiveOrder,
    SetWeights,
    VehicleAnswer,
)
from swarmctl.core.records import replace
from swarmctl.flight import app, companion
from swarmctl.flight.permission import Permission
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.outcome import FlightReport
from swarmctl.security.issue import make_keys
from swarmctl.security.participant import load_keyring
from swarmctl.security.requests import OperatorSigning
from swarmctl.station import commands
from swarmctl.station.commands import Answers

pytestmark = pytest.mark.virtual


def outcomes(answer: Answers) -> dict[str, str]:
    return {vehicle.name: vehicle.outcome for vehicle in answer}


def test_an_operator_launches_holds_and_recalls_three_agents(tmp_path: Path) -> None:
    async def scene() -> dict[int, FlightReport]:
        swarm = Swarm(tmp_path)
        for uav in NAMES:
            swarm.start(uav)
        early = await swarm.give(GiveOrder(None, "launch"))
        assert set(outcomes(early).values()) <= {"silent", "refused"}
        for uav in NAMES:
            await swarm.until(uav, Phase.STANDBY)
        await asyncio.sleep(30.0)
        assert {swarm.phase(uav) for uav in NAMES} == {Phase.STANDBY}  # no launch was ordered

        launched = await swarm.give(GiveOrder(None, "launch"))
        assert outcomes(launched) == dict.fromkeys(NAMES.values(), "taken")
        for uav in NAMES:
            await swarm.until(uav, Phase.FLYING)
        weighed = await swarm.give(SetWeights((1,), w=0.9))
        assert [(v.name, v.outcome) for v in weighed] == [("uav1", "taken")]
        await asyncio.sleep(15.0)
        assert outcomes(await swarm.give(GiveOrder((2, "uav3"), "hold"))) == {
            "uav2": "taken",
            "uav3": "taken",
        }
        for uav in (2, 3):
            await swarm.until(uav, Phase.HOLDING)
        assert outcomes(await swarm.give(GiveOrder(("uav3",), "return"))) == {"uav3": "taken"}
        assert outcomes(await swarm.give(GiveOrder((2,), "land"))) == {"uav2": "taken"}
        reports = dict(zip(NAMES, await asyncio.gather(*swarm.flights.values()), strict=True))
        gone = await swarm.give(GiveOrder(None, "hold"))
        assert commands.has_failed(GiveOrder(None, "hold"), gone)
        return reports

    reports = run_virtual(scene())
    for report in reports.values():
        assert report.bug is None
        assert report.trouble == ()
        assert report.ended == "ended"
    states = {uav: report.states[uav] for uav, report in reports.items()}
    assert [list(report.states) for report in reports.values()] == [[1], [2], [3]]
    assert states[1].outcome == ARRIVED
    assert states[1].w == 0.9
    assert (states[2].phase, states[2].order.given) == (Phase.DONE, FlightOrder.LAND)
    assert (states[3].phase, states[3].order.given) == (Phase.DONE, FlightOrder.RETURN)
    assert ARRIVED not in (states[2].outcome, states[3].outcome)
    # Each vehicle's observations are known to the others.
    for uav, state in states.items():
        others = [other for other in NAMES if other != uav]
        assert all(state.belief.n_cells_from(other) > 0 for other in others), uav


@pytest.fixture(scope="module")
def returned(tmp_path_factory: pytest.TempPathFactory) -> FlightReport:
    """Return the report on a flight with a recall by the operator."""

    async def scene() -> FlightReport:
        swarm = Swarm(tmp_path_factory.mktemp("returned"))
        swarm.start(2, "when-ready")
        await swarm.until(2, Phase.FLYING)
        await swarm.give(GiveOrder((2,), "return"))
        return await swarm.flights[2]

    return run_virtual(scene())


def code_of(report: FlightReport, folder: Path) -> int:
    try:
        conclude(report, companion.scenario_for(small(), 2), folder)
    except typer.Exit as ended:
        return ended.exit_code
    return 0


def test_a_followed_order_is_no_failure_and_stands_in_the_summary(
    returned: FlightReport, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (returned.states[2].phase, returned.states[2].order.given) == (Phase.DONE, FlightOrder.RETURN)
    assert code_of(returned, tmp_path) == 0
    *_, arrived, ended, folder = capsys.readouterr().out.splitlines()
    assert "0 of 1" in arrived
    assert "uav2" in ended
    assert str(tmp_path) in folder
    assert json.loads((tmp_path / "summary.json").read_text())["ended_by_operator"] == ["uav2"]


def test_a_recalled_vehicle_does_not_miss_its_time_bound(returned: FlightReport, tmp_path: Path) -> None:
    (vehicle,) = returned.summary["vehicles"]
    late = {**returned.summary, "vehicles": [vehicle | {"arrival_bound_kept": False, "arrive_within_s": 9.0}]}
    assert code_of(replace(returned, summary=late), tmp_path) == 0


NOT_FOLLOWED: list[tuple[str, dict[str, Any]]] = [
    ("failed", {"phase": Phase.FAILED}),
    ("released", {"phase": Phase.RELEASED}),
    ("lost on its way", {"phase": Phase.LEAVING}),
    ("not confirmed by telemetry", {"order": GivenOrder(FlightOrder.RETURN)}),
    ("no order", {"order": GivenOrder()}),
    ("ordered to hold", {"order": GivenOrder(FlightOrder.HOLD, is_followed=True)}),
    ("never took off", {"launch": Launch()}),
]


@pytest.mark.parametrize("changes", [row[1] for row in NOT_FOLLOWED], ids=[row[0] for row in NOT_FOLLOWED])
def test_a_vehicle_that_neither_arrives_nor_follows_an_order_has_failed(
    changes: dict[str, Any], returned: FlightReport, tmp_path: Path
) -> None:
    report = replace(returned, states={2: replace(returned.states[2], **changes)})
    assert report.ended_by_operator == []
    assert code_of(report, tmp_path) == 1


def test_a_stopped_flight_or_trouble_changes_the_exit_code(returned: FlightReport, tmp_path: Path) -> None:
    assert code_of(replace(returned, ended="stopped"), tmp_path) == 130
    assert code_of(replace(returned, trouble=("the disk is full",)), tmp_path) == 1


def test_an_agent_alone_flies_the_same_task_as_in_one_process(tmp_path: Path) -> None:
    async def scene() -> FlightReport:
        swarm = Swarm(tmp_path)
        swarm.start(2, "when-ready")
        return await swarm.flights[2]

    report = run_virtual(scene())
    scenario = small()
    assert report.all_arrived
    (vehicle,) = report.summary["vehicles"]
    (task,) = [task for task in scenario.tasks if task.uav == 2]
    assert vehicle["name"] == "uav2"
    assert report.states[2].task == task
    assert vehicle["cells_own"] > 0


def test_with_keys_only_the_operators_orders_and_the_vehicles_own_answers_count(tmp_path: Path) -> None:
    now = dt.datetime.now(dt.UTC)
    make_keys(tmp_path / "keys", ["uav1", "uav2", "operator"], 5, now)
    keyring = {name: load_keyring(tmp_path / "keys", name, now) for name in ("uav1", "uav2", "operator")}
    sent: list[tuple[str, bytes]] = []

    class Operators(OperatorSigning):
        def sign(self, uav: int | None, key: str, request: bytes) -> bytes:
            sent.append((key, super().sign(uav, key, request)))
            return sent[-1][1]

    async def scene(folder: Path, own: str) -> tuple[list[VehicleAnswer], list[VehicleAnswer]]:
        """Return the answers to the operator, and to a vehicle that gives orders."""
        folder.mkdir()
        bus, ui = MemoryBus(), Ui()
        flight = asyncio.create_task(
            companion.fly(
                companion.scenario_for(small(), 1),
                folder,
                ui,
                clock="virtual",
                permission=lambda foreign: None,
                launch="when-ready",
                bus=bus,
                keyring=keyring[own],
            )
        )
        await asyncio.sleep(20.0)
        given = [
            await commands.ask(
                bus, STATION, GiveOrder((1,), "land"), Operators("small", keyring[name], time.time)
            )
            for name in ("operator", "uav2")
        ]
        (replayed,) = await bus.ask(*sent[0], 5.0)
        assert (own != "uav1") or b"[command-replayed]" in replayed
        await flight
        return list(given[0]), list(given[1])

    (operators,), (vehicles,) = run_virtual(scene(tmp_path / "own", "uav1"))
    assert (operators.outcome, vehicles.outcome) == ("taken", "refused")
    assert vehicles.note.endswith("[not-signed]")
    sent.clear()
    # An agent with another vehicle's keys is not the asked vehicle.
    (operators,), _ = run_virtual(scene(tmp_path / "other", "uav2"))
    assert operators.outcome == "unconfirmed"
    assert operators.note.endswith("[wrong-token]")


@pytest.mark.full
@pytest.mark.parametrize("alone", [True, False], ids=["one vehicle", "all in one process"])
def test_a_bug_in_a_message_handler_is_reported_and_ends_no_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, alone: bool
) -> None:
    buses: list[MemoryBus] = []

    class Buggy(MemoryBus):
        """A bus with a handler that fails on every message of one key."""

        def __init__(self, on_failure: Failure) -> None:
            super().__init__(on_failure)
            buses.append(self)
            self.subscribe("outside", self._fails)
            self.serve("asked", self._fails)

        def _fails(self, *_: object) -> None:
            raise OverflowError("too many digits\x1b[2J")

    if alone:
        monkeypatch.setattr(companion, "MemoryBus", Buggy)
    else:
        kind = BusKind(lambda *_, on_failure: contextlib.closing(Buggy(on_failure)), is_networked=False)
        monkeypatch.setitem(BUSES, "memory", kind)

    async def scene(ui: Ui) -> FlightReport:
        scenario = small()
        permission: Permission = lambda foreign: None  # noqa: E731
        if alone:
            one = companion.scenario_for(scenario, 1)
            flying = companion.fly(
                one, tmp_path, ui, clock="virtual", permission=permission, launch="when-ready"
            )
        else:
            flying = app.fly(scenario, tmp_path, ui, clock="virtual", permission=permission)
        flight = asyncio.create_task(flying)
        await asyncio.sleep(20.0)
        for _ in range(3):
            buses[0].put("outside", b"")
        with contextlib.suppress(TimeoutError):
            await buses[0].ask("asked", b"", 1.0)
        return await flight

    ui = Ui()
    report = run_virtual(scene(ui))
    assert (report.bug, report.ended, report.all_arrived) == (None, "ended", True)
    assert buses[0].failed == 4
    (line,) = (text for text in ui.said if text.endswith("[receiver-bug]"))
    assert "OverflowError: too many digits?[2J" in line
    assert "test_companion.py:" in line


@pytest.mark.full
def test_an_operator_holds_a_vehicle_on_the_ground_and_launches_it_later(tmp_path: Path) -> None:
    async def scene() -> FlightReport:
        swarm = Swarm(tmp_path, small(simulate={"count": 3, "ready_s": 3.0, "delay_step_s": 60.0}))
        swarm.start(2, "when-ready")
        await swarm.until(2, Phase.STANDBY)
        held = await swarm.give(GiveOrder((2,), "hold"))
        assert "[stays-on-ground]" in held[0].note
        await asyncio.sleep(120.0)
        assert swarm.phase(2) is Phase.STANDBY
        assert outcomes(await swarm.give(GiveOrder((2,), "launch"))) == {"uav2": "taken"}
        return await swarm.flights[2]

    assert run_virtual(scene()).all_arrived


@pytest.mark.parametrize(
    ("url", "given", "simulated", "reached_at"),
    [
        ("udpin://127.0.0.1:14550", None, True, "udpin://127.0.0.1:0"),
        ("tcpin://127.0.0.1:5760", None, True, "tcpin://127.0.0.1:0"),
        ("udpin://127.0.0.1:0", "serial:///dev/ttyACM0:57600", False, "serial:///dev/ttyACM0:57600"),
    ],
)
def test_a_simulated_vehicle_gets_its_own_port_and_a_vehicle_with_a_url_is_real(
    url: str, given: str | None, simulated: bool, reached_at: str
) -> None:
    whole = small(simulate={"count": 3, "url": url})
    alone = companion.scenario_for(whole, 3, given)
    (spec,) = alone.specs
    assert (spec.name, spec.simulated, spec.url) == ("uav3", simulated, reached_at)
    assert alone.swarm == whole.swarm
    assert alone.tasks == whole.tasks[2:]
    assert spec.altitude_m == whole.specs[2].altitude_m


def test_one_process_with_all_vehicles_takes_orders_for_simulated_ones(tmp_path: Path) -> None:
    scenario = small(simulate={"count": 1, "ready_s": 3.0})
    report, (answer,) = fly_with_commands(scenario, tmp_path, (20.0, GiveOrder(None, "land")))
    assert [vehicle.outcome for vehicle in answer] == ["taken"]
    assert not report.all_arrived
    assert report.summary["operator_commands"] == {"passed_on": 1, "refused": 0}
