"""Pictures from records: the end is that of the summary, and each time is that of a fold from the begin."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from dashboard_page import Page, folded, messages_of, whole
from flights import fly, small
from group_flights import group
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.agent.replan.decide import believed_exposure
from swarmctl.agent.state import AgentState
from swarmctl.bus import keys
from swarmctl.bus.transports.memory import MemoryBus
from swarmctl.core.frames import Frame, FrameCodec, IntentPoint, IntentShared, StateShared
from swarmctl.dashboard import picture_parts
from swarmctl.dashboard.changes import changes
from swarmctl.dashboard.model import EVERYBODY, Timeline
from swarmctl.dashboard.picture import OCCUPIED, OWN, SEEN, Picture, SourceKind
from swarmctl.dashboard.server import in_background
from swarmctl.dashboard.sources.bus import BusSource
from swarmctl.dashboard.sources.recording import QUIET_AFTER_S, RecordSource
from swarmctl.flight.virtual_clock import run_virtual
from swarmctl.report import record
from swarmctl.report.record_file import RecordError, StoredMessage

pytestmark = pytest.mark.virtual

TWO = {"count": 2, "ready_s": 3.0}
WHOSE = st.sampled_from([EVERYBODY, "uav1", "uav2"])


@dataclass
class Flight:
    run: Path
    timeline: Timeline
    messages: list[StoredMessage]
    heard: BusSource
    """what a station heard on the bus during the flight"""
    summary: dict[str, Any]


class HeardBus(MemoryBus):
    """A bus on which a station listens."""

    def __init__(self, source: BusSource) -> None:
        super().__init__()
        self.source = source
        self.now_s = 0.0

    def put(self, key: str, payload: bytes) -> None:
        super().put(key, payload)
        if "/station/" in key:
            sent_s = FrameCodec("small").decode(payload).unix_s
            self.source.receive(key, payload, sent_s, sent_s)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    run = tmp_path_factory.mktemp("run")
    scenario = small(sensor={"p_miss": 0.1, "p_false_alarm": 0.02}, planner={"autonomy": 0.3}, simulate=TWO)
    heard = BusSource(scenario, FrameCodec("small"), 1767225600.0)
    summary = fly(scenario, run, bus=HeardBus(heard)).summary
    return Flight(run, whole(run), messages_of(run), heard, summary)


def test_the_end_of_a_record_is_that_of_the_summary(flight: Flight) -> None:
    picture = flight.timeline.at()
    for shown, told in zip(picture.vehicles, flight.summary["vehicles"], strict=True):
        assert (shown.name, shown.phase, shown.note) == (told["name"], told["phase"], told["outcome"])
        assert shown.cells_known == told["cells_own"] + told["cells_received"]
        assert shown.hostiles_known == told["hostiles_known"]
        assert (shown.strikes, shown.replans) == (told["strikes"], told["replans"])
        assert shown.battery_percent == told["battery_percent"]
        assert flight.timeline.vehicle(shown.name).motion.last.flown_m == pytest.approx(told["flown_m"])
        assert shown.progress == 1.0
    common = flight.timeline.common
    n_found = common.belief(common.version(picture.time_s)).belief.n_found
    assert n_found == flight.summary["hostiles"]["found"]
    n_strikes = sum(strike.count for strike in picture.strikes)
    assert n_strikes == sum(vehicle["strikes"] for vehicle in flight.summary["vehicles"])


@settings(max_examples=examples(5), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seeks=st.lists(st.tuples(st.floats(0.0, 1.0), WHOSE), min_size=1, max_size=3))
def test_each_seek_shows_what_a_fold_from_the_begin_shows(
    flight: Flight, seeks: list[tuple[float, str]]
) -> None:
    page, before = Page(), None
    for share, whose in seeks:
        time_s = share * flight.timeline.end_s
        picture = flight.timeline.at(time_s, whose)
        page.apply(changes(before, picture))
        before = picture
        begin = Page()
        anew = folded(flight.timeline, flight.messages, time_s).at(time_s, whose)
        begin.apply(changes(None, anew))
        assert without_source(picture) == without_source(anew)
        assert page.shown == begin.shown


def test_beliefs_and_exposures_are_those_of_the_agents(flight: Flight) -> None:
    states: dict[str, AgentState] = {}
    content = record.read(flight.run / "run.mcap")

    def keep(_before: object, _event: object, after: AgentState, *_: object) -> None:
        states[after.task.name] = after

    assert record.fold(content, flight.timeline.scenario, keep).difference == ""
    assert len(states) == 2
    for name, state in states.items():
        codes = flight.timeline.at(None, name).belief
        assert np.array_equal(codes & SEEN > 0, state.belief.looks > 0)
        assert np.array_equal(codes & OCCUPIED > 0, state.belief.known == 1)
        assert state.own is not None
        assert np.array_equal(codes & OWN > 0, state.own.looks > 0)
        p_s = believed_exposure(state.task, state.belief, state.strength, state.own)
        assert flight.timeline.exposure(name) == pytest.approx(p_s)


def test_a_change_of_a_route_tells_both_routes_and_what_was_learned(flight: Flight) -> None:
    changed = [change for change in flight.timeline.changes.items if change.old is not None]
    assert changed
    for change in changed:
        assert all(learned.observed_s <= change.time_s for learned in change.because)
        rest = picture_parts.rest_of_old(flight.timeline, change)
        if rest is not None:
            assert rest.cells == change.old.cells[-len(rest.cells) :]
            p_s = flight.timeline.exposure(change.vehicle, change.time_s)
            assert rest.exposure_sum == pytest.approx(sum(p_s[cell] for cell in rest.cells[1:]))
    assert any(picture_parts.rest_of_old(flight.timeline, change) is not None for change in changed)


def test_a_record_that_grows_is_shown_as_far_as_it_is_and_ages(flight: Flight, tmp_path: Path) -> None:
    content, growing = (flight.run / "run.mcap").read_bytes(), tmp_path / "run.mcap"
    growing.write_bytes(content[: len(content) // 2])
    now_s = 100.0
    source = RecordSource(tmp_path, "live file", clock=lambda: now_s)
    while source.read(1e9):
        pass
    half_s = source.timeline.end_s
    assert 0.0 < half_s < flight.timeline.end_s
    now_s += QUIET_AFTER_S + 1.0
    source.read()
    picture = source.timeline.at()
    assert picture.source.age_s == pytest.approx(QUIET_AFTER_S + 1.0)
    assert picture.source.text.endswith("[record-quiet]")
    assert all(vehicle.is_silent for vehicle in picture.vehicles)
    growing.write_bytes(content)
    while source.read(1e9):
        pass
    source.close()
    ended = source.timeline.at()
    assert not ended.source.is_live
    assert without_source(ended) == without_source(flight.timeline.at())


def without_source(picture: Picture) -> Any:
    """Return a picture as plain data, without the state of its source."""
    shown = msgspec.structs.asdict(picture)
    del shown["source"]

    def plain(each: Any) -> list[Any]:
        return each.tolist() if isinstance(each, np.ndarray) else list(each)

    return msgspec.to_builtins(shown, enc_hook=plain)


def test_a_cut_or_foreign_file_is_told(flight: Flight, tmp_path: Path) -> None:
    content = (flight.run / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(content[: len(content) // 2])
    cut = whole(tmp_path)
    assert 0.0 < cut.end_s < flight.timeline.end_s
    for wrong in (b"", b"not a record at all", content[:50]):
        (tmp_path / "run.mcap").write_bytes(wrong)
        with pytest.raises(RecordError):
            RecordSource(tmp_path, "recording")
    damaged = bytearray(content)
    damaged[len(content) // 2 : len(content) // 2 + 2000] = bytes(2000)
    (tmp_path / "run.mcap").write_bytes(damaged)
    with pytest.raises(RecordError):
        whole(tmp_path)
    with pytest.raises(RecordError):
        RecordSource(tmp_path / "nothing", "recording")


@pytest.mark.parametrize("kind", ["recording", "live file"])
def test_damage_ends_the_reading_of_its_run_and_is_told_on_the_page(
    kind: SourceKind, flight: Flight, tmp_path: Path
) -> None:
    damaged = bytearray((flight.run / "run.mcap").read_bytes())
    damaged[len(damaged) // 2 : len(damaged) // 2 + 2000] = bytes(2000)
    (tmp_path / "run.mcap").write_bytes(damaged)
    source, other = RecordSource(tmp_path, kind), RecordSource(flight.run, "recording")

    async def read_both() -> None:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(source.run())
            tasks.create_task(other.run())

    asyncio.run(read_both())
    picture = source.timeline.at()
    assert "[damaged]" in picture.source.text
    assert not picture.source.is_live
    assert picture.source.age_s == 0.0
    assert 0.0 < picture.source.total_s == picture.source.end_s < flight.timeline.end_s
    assert other.is_read
    source.close()
    other.close()


def test_a_mistake_in_a_source_reaches_the_handler_of_the_loop() -> None:
    reported: list[dict[str, Any]] = []

    async def mistake() -> None:
        raise KeyError("uav1")

    async def run() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: reported.append(context))
        await asyncio.wait([in_background(mistake())])
        await asyncio.sleep(0)

    asyncio.run(run())
    assert [type(context["exception"]) for context in reported] == [KeyError]


def test_a_station_on_the_bus_shows_what_the_record_shows(flight: Flight) -> None:
    assert flight.heard.board.refused == 0
    assert flight.heard.n_missed == 0
    live, kept = flight.heard.timeline.at(None, "uav1"), flight.timeline.at(None, "uav1")
    for heard, recorded in zip(live.vehicles, kept.vehicles, strict=True):
        for field in ("name", "phase", "note", "replans", "strikes", "battery_percent"):
            assert getattr(heard, field) == getattr(recorded, field)
        assert heard.cells_known == recorded.cells_known
        assert heard.hostiles_known == recorded.hostiles_known
        assert heard.position == pytest.approx(recorded.position, abs=1.0)
    # The vehicles hear each other, so the station knows that they hold what it has seen.
    assert np.array_equal(live.belief, kept.belief)
    flown = flight.heard.timeline.at(0.5 * flight.heard.timeline.end_s)
    assert all(v.route is not None and len(v.route.points) > 1 for v in flown.vehicles)
    assert flown.hearing


def test_costs_and_reasons_of_an_announced_route_follow_from_what_the_station_knows(flight: Flight) -> None:
    kept = {(c.vehicle, c.new.plan_id): c for c in flight.timeline.changes.items}
    heard = [c for c in flight.heard.timeline.changes.items if (c.vehicle, c.new.plan_id) in kept]
    replanned = [c for c in heard if c.old is not None]
    assert replanned
    for change in replanned:
        plan = kept[change.vehicle, change.new.plan_id].new
        # The announced flight begins at the vehicle, the plan at the centre of a cell.
        assert change.new.length_m == pytest.approx(plan.length_m, abs=75.0)
        assert change.new.exposure_sum == pytest.approx(plan.exposure_sum, abs=0.4)
        assert change.because


def test_a_vehicle_that_is_not_heard_is_shown_with_the_age_of_its_last_word(flight: Flight) -> None:
    codec = FrameCodec("small")
    source = BusSource(flight.timeline.scenario, codec, 100.0)
    source.move_on("", 102.0)
    assert [(v.is_silent, v.age_s) for v in source.timeline.at().vehicles] == [(True, None)] * 2
    lat_deg, lon_deg = flight.timeline.scenario.grid.centre((2, 2))
    flying = StateShared(5.0, lat_deg, lon_deg, 15.0, 315.0, "flying", 0, 0, last_seq=4)
    payload = codec.encode(Frame(1, 1, 1, 103.0, flying))
    source.receive(keys.to_station("small", 1), payload, 103.0, 103.0)
    source.move_on("", 104.0)
    assert not source.timeline.at().vehicles[0].is_silent
    # The vehicle has made four observations before the station began.
    assert source.n_missed == 4
    source.move_on("", 123.0)
    picture = source.timeline.at()
    shown = picture.vehicles[0]
    assert (shown.is_silent, shown.phase) == (True, "flying")
    assert shown.position == pytest.approx(flight.timeline.scenario.grid.centre_m((2, 2)))
    assert shown.age_s == pytest.approx(20.0)
    (alarm,) = [event for event in picture.events if event.severity == "alarm"]
    assert alarm.text.endswith("[vehicle-silent]")
    # It is shown again as it was.
    assert not source.timeline.at(4.0).vehicles[0].is_silent


def test_flights_that_are_announced_to_meet_are_a_conflict() -> None:
    scenario = small(simulate=TWO)
    timeline, grid = Timeline(scenario, "bus"), scenario.grid
    for uav, begin, end in ((1, (4, 0), (4, 6)), (2, (4, 6), (4, 0))):
        flown = ((0.0, begin), (30.0, end))
        points = tuple(IntentPoint(in_s, *grid.centre(cell), 340.0) for in_s, cell in flown)
        here = StateShared(5.0, *grid.centre(begin), 40.0, 340.0, "flying", 0, 0)
        timeline.shared(uav, 1.0, here, has_telemetry=False)
        timeline.intent(uav, 1.0, IntentShared(1, points), is_route=True)
    (conflict,) = timeline.at().conflicts
    assert conflict.vehicles == ("uav1", "uav2")
    assert conflict.in_s == pytest.approx(15.0, abs=2.0)
    assert conflict.at == pytest.approx(grid.centre_m((4, 3)), abs=20.0)
    # The second vehicle tells 4 s later that it lands.
    timeline.shared(
        2, 5.0, StateShared(9.0, *grid.centre((4, 6)), 40.0, 340.0, "landing", 0, 0), has_telemetry=False
    )
    timeline.intent(2, 5.0, IntentShared(1), is_route=True)
    assert timeline.at().conflicts == ()
    assert timeline.at(2.0).conflicts == (conflict,)


def test_a_station_receives_until_it_is_cancelled(flight: Flight) -> None:
    bus, codec = MemoryBus(), FrameCodec("small")
    source = BusSource(flight.timeline.scenario, codec, 0.0)
    lat_deg, lon_deg = flight.timeline.scenario.grid.centre((2, 2))

    async def station() -> None:
        hearing = asyncio.create_task(source.run(bus, lambda: "connected", lambda: 1.0))
        await asyncio.sleep(1.0)
        state = StateShared(5.0, lat_deg, lon_deg, 15.0, 315.0, "flying", 0, 0)
        bus.put(keys.to_station("small", 2), codec.encode(Frame(2, 1, 1, 1.0, state)))
        bus.put(keys.to_station("small", 2), b"no frame")
        await asyncio.sleep(2.0)
        hearing.cancel()

    run_virtual(station())
    picture = source.timeline.at()
    assert picture.vehicles[1].phase == "flying"
    assert picture.vehicles[1].age_s == pytest.approx(2.0, abs=0.3)
    assert source.board.refused == 1
    assert picture.source.text.startswith("connected")


def test_a_group_is_shown_with_its_leader_and_errors(tmp_path: Path) -> None:
    fly(group(), tmp_path)
    timeline = whole(tmp_path)
    shown = [timeline.at(float(time_s)).groups for time_s in range(int(timeline.end_s))]
    assert shown[0] == () == shown[-1]
    together = [groups[0] for groups in shown if groups and len(groups[0].members) == 3]
    assert {(g.name, g.members, g.leader) for g in together} == {("alpha", ("uav1", "uav2", "uav3"), "uav1")}
    assert all(error_m is not None for error_m in together[-1].errors_m)


def test_a_lost_link_that_is_reported_each_second_is_one_alarm() -> None:
    timeline = Timeline(small(simulate=TWO), "record")
    for time_s in (15.0, 16.0, 17.0):
        timeline.link_lost(1, time_s, time_s - 10.0)
    assert [event.severity for event in timeline.at().events] == ["alarm"]
    assert timeline.vehicles[1].words.last.lost_since_s == 10.0
