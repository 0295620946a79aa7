"""Reports of payloads, accepted and refused, over every transport; the example detector; a flight."""

from __future__ import annotations

import asyncio
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from flights import Ui, small
from hypothesis import given, settings
from hypothesis import strategies as st
from operator_station import Pair, memory_pair
from profiles import examples
from zenoh_nodes import here

from swarmctl.agent.replan.decide import first_route
from swarmctl.bus import keys
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.endpoint import BusEndpoint
from swarmctl.bus.external_observations import BURST, PER_S, SHOWN_AGAIN_AFTER_S, ReportCounts, ReportReceiver
from swarmctl.bus.sensor_reports import (
    MAX_AGE_S,
    MAX_BYTES,
    RejectedReport,
    RejectReason,
    Report,
    ReportAnswer,
    ReportedCells,
    ReportedPoint,
    decode_answer,
    decode_report,
    encode,
    report_schema,
)
from swarmctl.bus.transports import zenoh_config
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.bus.transports.open import open_bus
from swarmctl.bus.transports.zenoh import ZenohBus
from swarmctl.core.belief import CLEAR, OCCUPIED
from swarmctl.core.grid import Grid
from swarmctl.core.records import replace
from swarmctl.core.vehicle import VehicleState
from swarmctl.flight import app
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report.outcome import FlightReport as Flight
from swarmctl.security.requests import by_token
from swarmctl.security.token import new_token
from swarmctl.sensors import SOURCES, NoSensor

ROOT = Path(__file__).parents[2]
KEY = "swarmctl/test/uav/3/inform/look/sensor"
GRID = Grid(8, 10, 50.0, 46.0, 14.4)
NOW_S = 1_800_000_000.0


def report_of(**fields: Any) -> bytes:
    return json.dumps({"version": 1, **fields}).encode()


def point(cell: tuple[int, int], occupied: bool) -> dict[str, object]:
    lat_deg, lon_deg = GRID.centre(cell)
    return {"lat_deg": lat_deg, "lon_deg": lon_deg, "occupied": occupied}


ONE_CELL = [[4, 7, True]]
ONE_OBSERVED = ((4, 7, True),)
ACCEPTED: dict[str, bytes] = {
    "points in one cell that agree": report_of(points=[point((4, 7), True)] * 3),
    "a time a little ahead": report_of(cells=ONE_CELL, unix_s=NOW_S + 4.9),
    "a time at the age limit": report_of(cells=ONE_CELL, unix_s=NOW_S - MAX_AGE_S),
    "a time without a fraction": report_of(cells=ONE_CELL, unix_s=int(NOW_S)),
    "fields of later versions": report_of(cells=ONE_CELL, height_m=3.0, more={"x": [1]}),
    "null for missing fields": report_of(cells=ONE_CELL, points=None, unix_s=None),
}
NORTH = {"lat_deg": 91.0, "lon_deg": 14.4, "occupied": True}
REFUSED: dict[str, tuple[bytes, RejectReason]] = {
    "no JSON": (b"\x01\x02nonsense", RejectReason.MALFORMED),
    "no text": (b'{"version": 1, "source": "\xff"}', RejectReason.MALFORMED),
    "too deep": (b'{"x":' * 3000, RejectReason.MALFORMED),
    "no version": (b'{"cells": [[4, 7, true]]}', RejectReason.MALFORMED),
    "another version": (report_of(cells=ONE_CELL, version=2), RejectReason.VERSION),
    "a version of another shape": (b'{"version": 2, "cells": 5}', RejectReason.VERSION),
    "neither cells nor points": (report_of(), RejectReason.MALFORMED),
    "cells and points": (
        report_of(cells=ONE_CELL, points=[point((0, 0), False)]),
        RejectReason.MALFORMED,
    ),
    "no cells": (report_of(cells=[]), RejectReason.MALFORMED),
    "a row as text": (report_of(cells=[["4", 7, True]]), RejectReason.MALFORMED),
    "a row above the area": (report_of(cells=[*ONE_CELL, [8, 7, True]]), RejectReason.OUTSIDE),
    "a column beside the area": (report_of(cells=[[4, 10, True]]), RejectReason.OUTSIDE),
    "a huge row": (report_of(cells=[[10**400, 7, True]]), RejectReason.OUTSIDE),
    "a cell twice": (report_of(cells=[[4, 7, True], [4, 7, True]]), RejectReason.TWICE),
    "points that disagree": (
        report_of(points=[point((4, 7), True), point((4, 7), False)]),
        RejectReason.TWICE,
    ),
    "a point outside": (report_of(points=[NORTH | {"lat_deg": 45.0}]), RejectReason.OUTSIDE),
    "an impossible latitude": (report_of(points=[NORTH]), RejectReason.MALFORMED),
    "a longitude above 180": (
        report_of(points=[{"lat_deg": 46.001, "lon_deg": 374.401, "occupied": True}]),
        RejectReason.MALFORMED,
    ),
    "an infinite time": (
        b'{"version": 1, "cells": [[4, 7, true]], "unix_s": 1e999}',
        RejectReason.MALFORMED,
    ),
    "a time too long ago": (report_of(cells=ONE_CELL, unix_s=NOW_S - MAX_AGE_S - 0.2), RejectReason.STALE),
    "a time in the future": (report_of(cells=ONE_CELL, unix_s=NOW_S + 5.2), RejectReason.FUTURE),
    "a long source": (report_of(cells=ONE_CELL, source="x" * 33), RejectReason.MALFORMED),
    "a source with control characters": (report_of(cells=ONE_CELL, source="\x1b[2J"), RejectReason.MALFORMED),
    "too long": (report_of(cells=ONE_CELL, source="x" * MAX_BYTES), RejectReason.OVERSIZE),
}


# --- the schema


@pytest.mark.parametrize("name", ACCEPTED)
def test_a_report_gives_its_cells(name: str) -> None:
    assert decode_report(ACCEPTED[name], GRID, NOW_S)[0] == ONE_OBSERVED


@pytest.mark.parametrize("name", REFUSED)
def test_an_invalid_report_is_refused_with_its_reason(name: str) -> None:
    data, reason = REFUSED[name]
    with pytest.raises(RejectedReport) as refused:
        decode_report(data, GRID, NOW_S)
    assert refused.value.reason is reason
    assert str(refused.value).startswith(reason)


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("another version", "found 2"),
        ("a row above the area", "[8, 7]"),
        ("a column beside the area", "[4, 10]"),
        ("a cell twice", "[4, 7]"),
        ("points that disagree", "[4, 7]"),
        ("a point outside", "45.0000000, 14.4"),
        ("a time too long ago", "60.2 s"),
        ("a time in the future", "5.2 s"),
    ],
)
def test_a_refusal_names_what_was_found(name: str, found: str) -> None:
    with pytest.raises(RejectedReport) as refused:
        decode_report(REFUSED[name][0], GRID, NOW_S)
    assert found in str(refused.value)


@pytest.mark.parametrize(
    ("data", "value"),
    [
        (REFUSED["a huge row"][0], 10**400),
        (report_of(version=10**400), 10**400),
        (report_of(cells=ONE_CELL, source="x" * 10_000), "x" * 10_000),
    ],
    ids=["row", "version", "source"],
)
def test_a_refusal_shows_a_huge_value_only_in_part(data: bytes, value: object) -> None:
    """The text goes to the operator's screen and into the record."""
    with pytest.raises(RejectedReport) as refused:
        decode_report(data, GRID, NOW_S)
    assert str(value)[:40] not in str(refused.value)


numbers = st.integers() | st.floats()
json_values = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)
almost = st.fixed_dictionaries(
    {"version": st.just(1) | json_values},
    optional={
        "cells": st.lists(st.tuples(numbers, numbers, st.booleans()), max_size=4) | json_values,
        "points": st.lists(
            st.fixed_dictionaries({"lat_deg": numbers, "lon_deg": numbers, "occupied": st.booleans()}),
            max_size=4,
        )
        | json_values,
        "unix_s": numbers | json_values,
        "source": st.text(max_size=40) | json_values,
    },
)


@given(st.binary(max_size=80) | almost.map(lambda content: json.dumps(content).encode()))
@settings(max_examples=examples(200), deadline=None, derandomize=True)
def test_any_bytes_are_a_report_or_refused(data: bytes) -> None:
    with suppress(RejectedReport):
        cells, source = decode_report(data, GRID, NOW_S)
        assert cells
        assert len({(row, col) for row, col, _ in cells}) == len(cells)
        assert all(GRID.contains((row, col)) for row, col, _ in cells)
        assert len(source) <= 32
    with suppress(ValueError):
        decode_answer(data)


@given(
    st.lists(st.tuples(st.integers(0, 7), st.integers(0, 9)), min_size=1, max_size=20, unique=True),
    st.booleans(),
    st.booleans(),
)
@settings(max_examples=examples(60), deadline=None, derandomize=True)
def test_a_report_by_position_equals_a_report_by_cell(
    cells: list[tuple[int, int]], occupied: bool, by_cell: bool
) -> None:
    expected = tuple((row, col, occupied) for row, col in cells)
    if by_cell:
        report = Report(1, cells=expected)
    else:
        report = Report(1, points=tuple(ReportedPoint(*GRID.centre(cell), occupied) for cell in cells))
    assert decode_report(encode(report), GRID, NOW_S)[0] == expected


def test_the_published_schema_has_every_field_and_marks_the_required_ones() -> None:
    found = report_schema()
    report = found["$defs"]["Report"]
    assert set(report["properties"]) == {"version", "cells", "points", "unix_s", "source"}
    assert report["required"] == ["version"]
    assert report["properties"]["version"]["enum"] == [1]
    assert found["oneOf"] == [{"required": ["cells"]}, {"required": ["points"]}]
    assert set(found["$defs"]["ReportedPoint"]["required"]) == {"lat_deg", "lon_deg", "occupied"}


# --- reception over every transport


class Vehicle:
    """An agent that receives reports."""

    def __init__(
        self,
        transport: Transport,
        clock: Callable[[], float] = lambda: NOW_S,
        authentication: Authentication = NO_AUTHENTICATION,
    ) -> None:
        self.posted: list[tuple[ReportedCells, str]] = []
        self.said: list[str] = []
        self._changed = asyncio.Event()
        self.receiver = ReportReceiver(
            transport,
            "test",
            3,
            GRID,
            clock,
            self._post,
            self._say,
            authentication=authentication,
        )

    def _post(self, cells: ReportedCells, source: str) -> None:
        self.posted.append((cells, source))
        self._changed.set()

    def _say(self, text: str) -> None:
        self.said.append(text)
        self._changed.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        """Wait until a report makes the condition true."""
        async with asyncio.timeout(20.0):
            while not condition():
                self._changed.clear()
                await self._changed.wait()


@contextmanager
def over_an_endpoint(*, has_rules: bool = True) -> Iterator[tuple[Transport, Transport]]:
    """Yield the buses of the agent and of the payload; one process flies the swarm."""
    configuration = zenoh_config.whole_swarm(BusEndpoint("127.0.0.1", 0), "test", (1, 3))
    if not has_rules:
        values = {path: value for path, value in configuration.values.items() if path != "access_control"}
        configuration = replace(configuration, values=values)
    with ZenohBus(configuration) as agent:
        assert agent.endpoint is not None
        with ZenohBus(zenoh_config.visitor(agent.endpoint)) as payload:
            yield agent, payload


@contextmanager
def over_a_router() -> Iterator[tuple[Transport, Transport]]:
    """Yield the buses of the agent and of the payload; each agent is its own process."""
    at = here("tcp")
    with (
        ZenohBus(zenoh_config.router(at, "test", [1, 3])),
        ZenohBus(zenoh_config.client(at)) as agent,
        ZenohBus(zenoh_config.visitor(at)) as payload,
    ):
        yield agent, payload


@pytest.fixture(params=[memory_pair, over_an_endpoint, over_a_router])
def both(request: pytest.FixtureRequest) -> Pair:
    made: Pair = request.param
    return made


async def answered(payload: Transport, data: bytes) -> ReportAnswer:
    """Return the agent's answer; repeat the query until the agent is connected."""
    for _ in range(500):
        if answers := await payload.ask(KEY, data, 5.0):
            return decode_answer(answers[0])
        await asyncio.sleep(0.01)
    raise AssertionError("no answer")


def test_a_query_is_answered_with_the_accepted_cells(both: Pair) -> None:
    async def scene() -> None:
        with both() as (agent, payload):
            vehicle = Vehicle(agent)
            assert await answered(payload, report_of(cells=ONE_CELL, source="geiger")) == ReportAnswer(
                True, ONE_OBSERVED
            )
            assert vehicle.posted == [(ONE_OBSERVED, "geiger")]
            assert vehicle.said == []
            assert vehicle.receiver.counts == ReportCounts(1)

    asyncio.run(scene())


def test_a_query_is_answered_with_the_reason_of_a_refusal(both: Pair) -> None:
    async def scene() -> None:
        with both() as (agent, payload):
            vehicle = Vehicle(agent)
            too_long = report_of(cells=ONE_CELL, source="x" * MAX_BYTES)
            for data, why in ((report_of(cells=[[99, 0, True]]), "cell [99, 0]"), (too_long, "16384 bytes")):
                answer = await answered(payload, data)
                assert not answer.taken
                assert why in answer.why
            assert vehicle.posted == []
            assert vehicle.receiver.counts == ReportCounts(
                0, {RejectReason.OUTSIDE: 1, RejectReason.OVERSIZE: 1}
            )
            assert all(text in vehicle.said[0] for text in ("(1 ", RejectReason.OUTSIDE, "[99, 0]"))

    asyncio.run(scene())


def test_a_put_report_is_accepted_or_counted(both: Pair) -> None:
    async def scene() -> None:
        with both() as (agent, payload):
            vehicle = Vehicle(agent)
            await answered(payload, report_of(cells=ONE_CELL))  # both buses are connected
            payload.put(KEY, report_of(cells=[[1, 1, False]], source="camera"))
            payload.put(KEY, b"nonsense")
            await vehicle.until(lambda: bool(vehicle.receiver.counts.refused))
            assert vehicle.posted[1:] == [(((1, 1, False),), "camera")]
            assert vehicle.receiver.counts == ReportCounts(2, {"malformed": 1})

    asyncio.run(scene())


@pytest.mark.parametrize("has_rules", [True, False])
@pytest.mark.parametrize(
    "key", ["swarmctl/test/uav/*/inform/look/sensor", "swarmctl/test/uav/**", "swarmctl/**"]
)
def test_a_report_under_a_wildcard_is_refused(key: str, has_rules: bool) -> None:
    """The access rules keep it out, and without them the receiver refuses it."""

    async def scene() -> None:
        with over_an_endpoint(has_rules=has_rules) as (agent, payload):
            vehicle = Vehicle(agent)
            await answered(payload, report_of(cells=ONE_CELL))
            assert await payload.ask(key, report_of(cells=[[1, 1, False]]), 5.0) == ()
            payload.put(key, report_of(cells=[[1, 1, False]]))
            payload.put(KEY, report_of(cells=ONE_CELL))
            await vehicle.until(lambda: len(vehicle.posted) == 2)
            assert vehicle.posted == [(ONE_OBSERVED, ""), (ONE_OBSERVED, "")]
            assert vehicle.receiver.counts == ReportCounts(2, {} if has_rules else {RejectReason.KEY: 2})
            assert [key in text for text in vehicle.said] == ([] if has_rules else [True])

    asyncio.run(scene())


def test_reports_of_another_vehicle_are_ignored(both: Pair) -> None:
    async def scene() -> None:
        with both() as (agent, payload):
            vehicle = Vehicle(agent)
            await answered(payload, report_of(cells=ONE_CELL))
            for key in ("swarmctl/test/uav/4/inform/look/sensor", "swarmctl/other/uav/3/inform/look/sensor"):
                assert await payload.ask(key, report_of(cells=ONE_CELL), 5.0) == ()
                payload.put(key, report_of(cells=ONE_CELL))
            await answered(payload, report_of(cells=ONE_CELL))
            assert vehicle.receiver.counts == ReportCounts(2)

    asyncio.run(scene())


# --- rate limit and messages


def test_reports_above_the_rate_limit_are_refused() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        vehicle = Vehicle(bus)
        for _ in range(BURST):
            assert (await answered(bus, report_of(cells=ONE_CELL))).taken
        answer = await answered(bus, report_of(cells=ONE_CELL))
        assert not answer.taken
        await asyncio.sleep(1.0 / PER_S)
        assert (await answered(bus, report_of(cells=ONE_CELL))).taken
        assert not (await answered(bus, report_of(cells=ONE_CELL))).taken
        await asyncio.sleep(10.0)
        assert [(await answered(bus, report_of(cells=ONE_CELL))).taken for _ in range(BURST + 1)] == [
            True
        ] * BURST + [False]
        assert vehicle.receiver.counts == ReportCounts(2 * BURST + 1, {RejectReason.TOO_FAST: 3})

    run_virtual(scene())


def test_invalid_reports_use_up_the_rate_limit() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        vehicle = Vehicle(bus)
        for _ in range(BURST + 10):
            await answered(bus, b"nonsense")
        assert vehicle.receiver.counts == ReportCounts(
            0, {RejectReason.MALFORMED: BURST, RejectReason.TOO_FAST: 10}
        )

    run_virtual(scene())


def test_each_reason_is_reported_once_until_a_pause() -> None:
    async def scene() -> None:
        bus = MemoryBus()
        vehicle = Vehicle(bus)
        for _ in range(100):
            await answered(bus, b"nonsense")
            await answered(bus, report_of(cells=[[99, 0, True]]))
            await asyncio.sleep(1.0)
        assert [text.split(": ")[1] for text in vehicle.said] == [
            RejectReason.MALFORMED,
            RejectReason.OUTSIDE,
        ]
        await asyncio.sleep(SHOWN_AGAIN_AFTER_S)
        await answered(bus, b"nonsense")
        assert len(vehicle.said) == 3
        assert "(201 so far)" in vehicle.said[2]

    run_virtual(scene())


# --- the configuration


def test_a_vehicle_with_an_external_sensor_only_has_no_simulated_sensor() -> None:
    assert SOURCES["external"].sensor is NoSensor
    assert NoSensor().observe(VehicleState(lat_deg=46.001, lon_deg=14.401, alt_rel_m=40.0, armed=True)) == ()


# --- a flight


class TakeoffUi(Ui):
    """A user interface that sets an event when one vehicle is in the air."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.reached = asyncio.Event()
        self._waited_for = f"{name}: launching → flying"

    def log(self, text: str) -> None:
        super().log(text)
        if text == self._waited_for:
            self.reached.set()


def flown(folder: Path, *reports: tuple[str, int, bytes]) -> tuple[Flight, list[ReportAnswer]]:
    """Fly three vehicles with reports as their only sensor, each (when, vehicle, content)."""
    scenario = small(sensor={"source": "external"})
    answers: list[ReportAnswer] = []

    async def scene() -> Flight:
        bus, ui = MemoryBus(), TakeoffUi("uav2")

        async def payload() -> None:
            for when, uav, data in reports:
                if when == "in flight":
                    await ui.reached.wait()
                else:
                    await asyncio.sleep(1.0)
                (answer,) = await bus.ask(keys.sensor_report(scenario.config.name, uav), data, 5.0)
                answers.append(decode_answer(answer))

        playing = asyncio.create_task(payload())
        flight = app.fly(scenario, folder, ui, clock="virtual", permission=lambda foreign: None, bus=bus)
        report = await flight
        async with asyncio.timeout(60.0):
            await playing
        return report

    folder.mkdir()
    return run_virtual(scene()), answers


@pytest.mark.full
def test_a_swarm_without_reports_from_its_external_sensors_keeps_its_routes(tmp_path: Path) -> None:
    blind, _ = flown(tmp_path / "blind")
    assert blind.bug is None
    assert all(state.belief.n_observed == 0 for state in blind.states.values())
    assert [state.plans.replans for state in blind.states.values()] == [0, 0, 0]


def test_a_swarm_with_external_sensors_flies_by_their_reports_only(tmp_path: Path) -> None:
    scenario = small()
    (task,) = (task for task in scenario.tasks if task.uav == 2)
    cells = first_route(task, scenario.prior).cells
    ahead = cells[len(cells) // 2]
    report, answers = flown(
        tmp_path / "reported",
        ("on the ground", 3, report_of(cells=[[0, 0, False]])),
        ("in flight", 2, report_of(cells=[[*ahead, True]], source="camera")),
        ("in flight", 1, report_of(cells=[[99, 0, True]])),
    )
    assert report.bug is None
    assert [answer.taken for answer in answers] == [True, True, False]
    for state in report.states.values():  # each vehicle has both valid reports
        assert state.belief.known[ahead] == OCCUPIED
        assert state.belief.known[0, 0] == CLEAR
        assert state.belief.n_observed == 2
    assert report.states[2].plans.replans >= 1
    assert ahead not in report.states[2].flown.cells
    assert report.all_arrived
    assert [vehicle["payload_reports"] for vehicle in report.summary["vehicles"]] == [
        {"taken": 0, "refused": {RejectReason.OUTSIDE: 1}},
        {"taken": 1, "refused": {}},
        {"taken": 1, "refused": {}},
    ]


# --- the example


@pytest.mark.interop
def test_the_example_detector_sends_one_report_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    token = new_token()

    async def scene() -> None:
        with open_bus("test", (3,), "tcp/127.0.0.1:0", token.text, print) as agent:
            vehicle = Vehicle(agent, time.time, by_token("test", token, 5.0, time.time))
            example = await asyncio.create_subprocess_exec(
                sys.executable,
                ROOT / "configs" / "detector.py",
                "test",
                "3",
                env={**os.environ, "TMPDIR": str(tmp_path)},
            )
            try:
                await vehicle.until(lambda: len(vehicle.posted) == 2)
            finally:
                example.terminate()
                await example.wait()
            assert vehicle.posted[0] == (((4, 7, True), (4, 8, False)), "detector")
            assert vehicle.receiver.counts.refused == {}

    asyncio.run(scene())
