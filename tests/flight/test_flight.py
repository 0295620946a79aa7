"""Whole flights on the virtual clock: agents, links, conversations and simulated vehicles together."""

from __future__ import annotations

import asyncio
import errno
import json
from collections import Counter
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from flights import AREA, FaultyUi, Ui, coded, fly, small
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from profiles import examples
from recorded import effects, messages, on_the_wire
from trouble import Trouble, interrupting, outage

from swarmctl.agent.phases import Phase
from swarmctl.config import model
from swarmctl.config.checks import check_config
from swarmctl.config.scenario import Scenario, build
from swarmctl.flight import virtual_simulator
from swarmctl.flight.run import FlightOptions
from swarmctl.links.transports.base import Address, Receive
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.report import record
from swarmctl.report.live_rows import NOT_YET, OK
from swarmctl.report.outcome import FlightReport

pytestmark = pytest.mark.virtual

ALONE, PAIR = ({"count": n, "ready_s": 3.0} for n in (1, 2))
SHIPPED = Path(__file__).parents[2] / "configs" / "swarm.yaml"


Shipped = tuple[Scenario, FlightReport, Path]


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Shipped:
    scenario = build(model.load(SHIPPED, check_config))
    folder = tmp_path_factory.mktemp("shipped")
    return scenario, fly(scenario, folder), folder


def test_the_shipped_swarm_arrives(shipped: Shipped) -> None:
    _, report, _ = shipped
    assert report.trouble == ()
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 5
    # A copter sees one cell ahead, so it has to turn off at the centre of its own cell.
    assert sum(s.plans.replans for s in report.states.values()) >= 10
    for state in report.states.values():
        assert state.flown.cells[-1] in state.task.goals
        assert state.flown.length_m > 1000.0


def test_normal_preparation_shows_neither_notes_nor_warnings(tmp_path: Path) -> None:
    ui = Ui()
    fly(small(simulate={"count": 2, "ready_s": 15.0}), tmp_path, ui=ui)
    *answers, ready = ui.said[:3]
    assert ready.endswith("[ready]")
    assert [line.partition(":")[0] for line in answers] == ["uav1", "uav2"]
    on_ground = [row for view in ui.views if view.flown_s == 0.0 for row in view.rows]
    assert Phase.WAITING in {row.phase for row in on_ground}
    assert {(row.note, row.link, row.silence) for row in on_ground} <= {("", OK, ""), ("", NOT_YET, "")}


def test_every_agent_ends_with_the_same_belief(shipped: Shipped) -> None:
    _, report, _ = shipped
    beliefs = {s.belief.known.tobytes() for s in report.states.values()}
    assert len(beliefs) == 1


def test_beliefs_match_the_true_hostiles(shipped: Shipped) -> None:
    scenario, report, _ = shipped
    known = report.states[1].belief.known
    for row in range(20):
        for col in range(20):
            if known[row, col] >= 0:
                assert known[row, col] == ((row, col) in scenario.hostiles)


def test_the_summary_holds_latencies_and_vehicles(shipped: Shipped) -> None:
    _, report, folder = shipped
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["arrival"] is None  # the vehicles arrive independently
    assert summary["seed"] == 7
    assert summary["configuration"]["planner"]["w"] == 0.5
    assert summary["versions"]["swarmctl"]
    for name in ("observation_to_last_peers_belief_s", "observation_to_last_changed_mission_s"):
        latency = summary["latency"][name]
        assert 0.0 <= latency["p50"] <= latency["p99"] <= latency["max"]
    assert (
        sum(row["latency"]["observation_to_last_peers_belief_s"]["n"] for row in summary["vehicles"])
        == summary["latency"]["observation_to_last_peers_belief_s"]["n"]
    )
    for row, state in zip(report.summary["vehicles"], report.states.values(), strict=True):
        assert row["flown_m"] == state.flown.length_m
        assert row["strikes"] == state.vehicle.strikes
        assert row["communication_penalty"] == pytest.approx(0.01 * state.flown.length_m)
        assert row["messages_sent"] == sum(row["network"]["sent"].values())
        assert row["network"]["sent"]["inform/state"] % 4 == 0
        assert row["network"]["refused"] == row["network"]["lost"] == {}
        assert row["cells_own"] + row["cells_received"] == state.belief.n_observed


def test_other_readers_open_the_record(shipped: Shipped) -> None:
    _, _, folder = shipped
    with (folder / "run.mcap").open("rb") as file:
        topics = Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())
        file.seek(0)
        schemas = {s.name: json.loads(s.data) for s, _, _ in make_reader(file).iter_messages() if s}
    assert topics["/uav2/location"] > 100
    assert topics["/uav1/route"] == len(list(effects(folder, "SwapMission", "uav1"))) > 1
    assert topics["/log"] > 10
    assert len(topics) < 20
    assert {s["type"] for s in schemas.values()} == {"object"}
    assert {"foxglove.LocationFix", "foxglove.GeoJSON", "foxglove.Log"} <= set(schemas)


def test_the_record_draws_area_hostiles_and_routes_on_a_map(shipped: Shipped) -> None:
    scenario, report, folder = shipped

    def shapes(topic: str) -> list[dict[str, Any]]:
        (*_, last) = messages(folder, topic)
        features: list[dict[str, Any]] = json.loads(last["geojson"])["features"]
        return features

    assert len(shapes("/map/hostiles")) == len(scenario.hostiles)
    assert len(shapes("/map/found")) == max(state.belief.n_found for state in report.states.values())
    (route,) = shapes("/uav1/route")
    accepted = report.states[1].plans.accepted
    assert accepted is not None
    landing = accepted.plan.landing
    assert route["geometry"]["coordinates"][-1] == pytest.approx([landing.lon_deg, landing.lat_deg], abs=1e-6)


def test_the_layout_shows_topics_that_the_record_has(shipped: Shipped) -> None:
    _, _, folder = shipped
    layout = json.loads((folder / "foxglove.json").read_text(encoding="utf-8"))
    for topic in layout["configById"]["map!swarm"]["topicColors"]:
        assert next(messages(folder, topic))


def test_pymavlink_reads_the_tlog_of_each_vehicle(shipped: Shipped) -> None:
    _, _, folder = shipped
    for sysid in range(1, 6):
        messages_on_the_wire = on_the_wire(folder, f"uav{sysid}")
        seen = Counter((m.get_srcSystem(), m.get_type()) for m in messages_on_the_wire)
        assert seen[sysid, "HEARTBEAT"] > 100
        assert seen[255, "MISSION_COUNT"] >= 1
        assert {system for system, _ in seen} == {sysid, 255}


def test_the_plan_files_hold_the_last_missions(shipped: Shipped) -> None:
    _, report, folder = shipped
    for sysid, state in report.states.items():
        plan = json.loads((folder / f"uav{sysid}.plan").read_text())
        assert plan["fileType"] == "Plan"
        items = plan["mission"]["items"]
        assert [items[0]["command"], items[-1]["command"]] == [22, 21]
        assert state.plans.mission is not None
        assert [tuple(i["params"][4:6]) for i in items[1:-1]] == [
            (p.lat_deg, p.lon_deg) for p in state.plans.mission.plan.track
        ]


def test_the_map_is_drawn(shipped: Shipped) -> None:
    _, _, folder = shipped
    assert (folder / "map.png").read_bytes().startswith(b"\x89PNG")


def test_a_replay_makes_the_same_decisions(shipped: Shipped) -> None:
    _, _, folder = shipped
    verdict = record.replay(folder / "run.mcap")
    assert verdict.difference == ""
    assert verdict.events > 1000
    assert verdict.effects > 100


OLD, NEW = ("simulated", 2), ("moved", 2)


class MovedWire(MemoryWire):
    """A wire on which the second vehicle sends from another address from 45 s on."""

    def __init__(self, wire: MemoryWire) -> None:
        super().__init__()
        self._wire = wire

    def from_vehicle(self, data: bytes, address: Address) -> None:
        is_moved = address == OLD and asyncio.get_running_loop().time() >= 45.0
        self._wire.from_vehicle(data, NEW if is_moved else address)

    def connect_vehicles(self, receive: Receive | None) -> None:
        def deliver(data: bytes, address: Address) -> None:
            if receive is not None:
                receive(data, OLD if address == NEW else address)

        self._wire.connect_vehicles(deliver)


def test_a_silent_vehicle_is_shown_lost_and_then_restored(tmp_path: Path) -> None:
    ui, cut = Ui(), outage(20.0, at_s=25.0)

    async def simulate(wire: MemoryWire, scenario: Scenario) -> None:
        await virtual_simulator.serve(MovedWire(wire), cut.fleet_of(scenario))

    report = fly(small(simulate=PAIR), tmp_path, options=FlightOptions(simulate=simulate), ui=ui)
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 2
    assert len(coded(ui.said, "uav2", "telemetry-lost")) == 1
    assert len(coded(ui.said, "uav2", "telemetry-back")) == 1
    links = {row.link for view in ui.views for row in view.rows if row.name == "uav2"}
    assert "lost for 10 s" in links
    assert {row.link for row in ui.views[-1].rows} == {OK}
    others = {row.link for view in ui.views for row in view.rows if row.name != "uav2"} - {NOT_YET}
    assert others == {OK}


def test_a_vehicle_that_never_answers_stops_the_flight_before_any_arming(tmp_path: Path) -> None:
    report = fly(small(), tmp_path, trouble=outage(at_s=0.0))
    assert report.ended == "failed"
    (line,) = report.trouble
    assert "uav2 (system 2" in line
    assert "[no-heartbeat]" in line
    assert " 15 s" in line
    assert not any(s.vehicle.armed for s in report.states.values())
    assert all(s.plans.mission is None for s in report.states.values())


@pytest.mark.parametrize(
    ("on_exit", "modes", "landed"),
    [
        ("hold", {"GUIDED"}, False),
        pytest.param("return", {"RTL"}, True, marks=pytest.mark.full),
        ("land", {"LAND"}, True),
    ],
)
def test_ctrl_c_holds_and_then_acts_as_configured(
    on_exit: str, modes: set[str], landed: bool, tmp_path: Path
) -> None:
    scenario = small(flight={"on_exit": on_exit}, simulate=PAIR)
    report = fly(scenario, tmp_path, trouble=interrupting(30.0))
    assert report.ended == "stopped"
    assert {s.vehicle.mode for s in report.states.values()} == modes
    assert all(s.vehicle.armed is not landed for s in report.states.values())
    assert [line.endswith("[in-air]") for line in report.final_states] == [not landed] * 2


def test_ctrl_c_before_the_launch_keeps_every_vehicle_on_the_ground(tmp_path: Path) -> None:
    report = fly(small(), tmp_path, trouble=interrupting(3.0))
    assert report.ended == "stopped"
    assert not any(s.vehicle.armed for s in report.states.values())


@pytest.mark.full
@pytest.mark.parametrize("k", [1, 0, 2, "all"])
def test_messages_reach_as_many_vehicles_as_the_configured_range(k: int | str, tmp_path: Path) -> None:
    scenario = small(
        communication={"bus": "memory", "range": k, "sync_every_s": 0.0},
        simulate={"count": 4, "ready_s": 3.0},
    )
    report = fly(scenario, tmp_path)
    assert report.all_arrived
    reach = 3 if k == "all" else k
    sent: Counter[str] = Counter()
    for published in effects(tmp_path, "Publish"):
        kind = published["effect"]["message"]["type"]
        sent[published["vehicle"]] += kind in ("inform/observation", "inform/state")
    n_informed = 0
    rows = {row["sysid"]: row for row in report.summary["vehicles"]}
    for sysid, state in report.states.items():
        own = sent[f"uav{sysid}"]
        spoken = rows[sysid]["network"]["sent"]
        assert spoken.get("inform/observation", 0) + spoken.get("inform/state", 0) == own * reach
        others = {o.observer for o in state.belief.items()} - {sysid}
        n_informed += bool(others)
    # With one or two neighbours in reach a vehicle may be no other's nearest; then it receives nothing.
    assert (n_informed == 4) if reach == 3 else (n_informed > 0) is (reach > 0)


@pytest.mark.full
def test_vehicles_take_off_one_after_the_other_if_configured(tmp_path: Path) -> None:
    scenario = small(simulate={"count": 3, "ready_s": 3.0, "delay_step_s": 10.0})
    report = fly(scenario, tmp_path)
    starts = [report.statistics.vehicles[n].took_off_s for n in (1, 2, 3)]
    assert all(s is not None for s in starts)
    gaps = [b - a for a, b in pairwise(starts)]  # type: ignore[operator]
    assert gaps == pytest.approx([10.0, 10.0], abs=1.5)


@pytest.mark.full
@pytest.mark.parametrize("loss", [0.1, 0.3])
def test_frame_loss_delays_the_swarm_but_does_not_stop_it(loss: float, tmp_path: Path) -> None:
    # With some seeds five heartbeats or mission starts in a row are lost, and a vehicle does not launch.
    report = fly(
        small(), tmp_path, trouble=Trouble(faults=[{"fault": "packet_loss", "params": {"rate": loss}}])
    )
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 3


OUTAGES = st.lists(st.tuples(st.integers(1, 3), st.floats(10.0, 120.0), st.floats(0.5, 30.0)), max_size=6)


@pytest.mark.full
@given(OUTAGES)
@settings(max_examples=examples(4), deadline=None, derandomize=True)
def test_every_vehicle_arrives_after_link_outages_of_any_kind(
    outages: list[tuple[int, float, float]],
) -> None:
    faults = [
        {"fault": "link_outage", "vehicles": [uav], "at_s": since_s, "for_s": for_s}
        for uav, since_s, for_s in outages
    ]
    with TemporaryDirectory() as folder:
        report = fly(small(), Path(folder), trouble=Trouble(faults=[*faults]))
    assert report.ended == "ended"
    assert [s.outcome for s in report.states.values()] == ["arrived"] * 3


@pytest.mark.parametrize(
    "error",
    [BrokenPipeError(), pytest.param(SystemExit(1), marks=pytest.mark.full)],
    ids=["closed pipe", "Rich's way out"],
)
def test_a_terminal_that_goes_away_does_not_end_the_flight(error: BaseException, tmp_path: Path) -> None:
    report = fly(small(simulate=ALONE), tmp_path, ui=FaultyUi(error=error))
    assert report.all_arrived


def test_a_full_disk_ends_the_record_and_not_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("mcap.writer.Writer.add_message", full)
    report = fly(small(simulate=ALONE), tmp_path)
    assert report.all_arrived
    (line,) = report.trouble
    assert "run.mcap" in line
    assert "No space left on device" in line


@pytest.mark.full
def test_no_route_leads_past_the_corner_of_a_forbidden_cell(tmp_path: Path) -> None:
    block = [[row, col] for row in (3, 4) for col in (3, 4)]
    report = fly(small(area={**AREA, "no_fly": block}), tmp_path)
    assert report.all_arrived
    for state in report.states.values():
        assert state.flown.no_fly_entered == 0
        assert not {tuple(cell) for cell in block} & set(state.flown.cells)


def test_vehicles_that_share_goals_in_a_chain_land_apart(tmp_path: Path) -> None:
    start = {"lat_deg": 46.0, "lon_deg": 14.399}
    zones = [[[3, 6], [3, 7]], [[3, 7], [4, 7]], [[4, 7], [4, 6]]]
    vehicles = [
        {"name": f"v{n}", "url": "udpin://:14550", "sysid": n, "start": start, "goal": zone}
        for n, zone in enumerate(zones, start=1)
    ]
    tasks = small(vehicles=vehicles, simulate=None).tasks
    spots = {(t.landing_index, t.landing_count) for t in tasks}
    assert len(spots) == 3
    assert {count for _, count in spots} == {3}
