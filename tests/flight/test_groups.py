"""Groups in formation, in whole flights on the virtual clock, by the records of their agents."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path

import pytest
from evidence_files import sent_to
from flights import AREA, Ui, coded, fly, fly_with_commands
from group_flights import COLS, ROWS, group, in_place, rms, seen, settled, turn_cells
from profiles import full_only

from swarmctl.agent.state import ARRIVED
from swarmctl.core.messages import GiveOrder, SetWeights
from swarmctl.report.evidence.chain import check
from swarmctl.report.evidence.log import FILE_NAME

pytestmark = pytest.mark.virtual

APPROACHES = ["leader_following", "behavioural", "virtual_structure"]
full = pytest.mark.full
MISSION = 0  # MAV_MISSION_TYPE


def on_each_autopilot(*in_short: tuple[str, str]) -> pytest.MarkDecorator:
    """Run a test for each approach and autopilot, outside of the full run for those of `in_short` alone."""
    pairs = product(APPROACHES, ["ardupilot", "px4"])
    cases = [pytest.param(*pair, marks=() if pair in in_short else full) for pair in pairs]
    return pytest.mark.parametrize(("approach", "autopilot"), cases)


@on_each_autopilot(("leader_following", "ardupilot"), ("virtual_structure", "px4"))
def test_members_keep_their_places_at_10_m_s_with_100_ms_of_delay(
    approach: str, autopilot: str, tmp_path: Path
) -> None:
    scenario = group(approach, simulate={"autopilot": autopilot})
    report = fly(scenario, tmp_path)
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 3
    assert report.summary["separation"]["too_close"] == []
    members = in_place(tmp_path, scenario)
    assert set(members) == ({2, 3} if approach == "leader_following" else {1, 2, 3})
    for rows in members.values():
        assert rows[-1].boot_s - rows[0].boot_s > 30.0
        assert rms([row.across_m for row in rows]) < 1.0
        assert rms([row.along_m for row in rows]) < 2.0


@full
@pytest.mark.parametrize("approach", APPROACHES)
def test_two_seconds_without_messages_of_the_leader_move_nobody_by_5_m(approach: str, tmp_path: Path) -> None:
    quiet = [{"uavs": ["uav1"], "from_s": 45.0, "until_s": 47.0}]
    scenario = group(approach, communication={"quiet": quiet})
    report = fly(scenario, tmp_path)
    assert report.summary["separation"]["too_close"] == []
    for rows in filter(None, seen(tmp_path, scenario).values()):
        assert max(row.error_m for row in settled(rows, 44.0)) < 5.0


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_group_keeps_its_shape_beside_a_hostile_that_it_passes_sooner_than_it_changes(
    autopilot: str, tmp_path: Path
) -> None:
    scenario = group(
        formation={"narrow_shape": {"kind": "column", "spacing_m": 25.0}},
        threats={"count": 3, "hostiles": [[ROWS // 2 + 1, 4], [ROWS // 2 - 2, 7], [ROWS // 2 + 1, 10]]},
        simulate={"autopilot": autopilot},
    )
    ui = Ui()
    (alpha,) = fly(scenario, tmp_path, ui=ui).summary["formations"]
    assert alpha["shape_changes"] == len(coded(ui.said, "uav1", "shape")) == 0


def test_a_group_changes_its_shape_for_a_gap(tmp_path: Path) -> None:
    wall = [[row, COLS // 2] for row in range(ROWS) if row != ROWS // 2]
    scenario = group(
        area={**AREA, "rows": ROWS, "cols": COLS, "no_fly": wall},
        formation={
            "members": ["uav2", "uav1", "uav3"],
            "shape": {"kind": "line", "spacing_m": 45.0},
            "narrow_shape": {"kind": "column", "spacing_m": 20.0},
        },
        simulate={"start_spacing_m": 45.0},
    )
    ui = Ui()
    report = fly(scenario, tmp_path, ui=ui)
    (alpha,) = report.summary["formations"]
    assert alpha["shape_changes"] == len(coded(ui.said, "uav2", "shape")) >= 1
    times_s = alpha["time_in_shapes_s"]
    assert times_s["narrow_shape"] > 5.0
    assert sum(times_s.values()) == pytest.approx(alpha["led_s"]["uav2"])
    assert [vehicle["no_fly_cells_entered"] for vehicle in report.summary["vehicles"]] == [0, 0, 0]
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 3


def test_a_group_of_copters_that_stop_for_missions_does_not_stop_for_a_new_route(tmp_path: Path) -> None:
    scenario = group(threats={"count": 1, "hostiles": [[ROWS // 2, COLS // 2]]})
    assert fly(scenario, tmp_path).summary["separation"]["too_close"] == []
    leader = seen(tmp_path, scenario)[1]
    under_way = [row for row in leader if row.boot_s < leader[-1].boot_s - 5.0]
    assert min(row.speed_m_s for row in under_way) > 2.0


@full
@pytest.mark.parametrize("approach", APPROACHES)
def test_a_group_splits_at_a_wall_with_gaps_and_meets_again(approach: str, tmp_path: Path) -> None:
    rows, cols = 15, 17
    scenario = group(
        approach,
        area={**AREA, "rows": rows, "cols": cols, "no_fly": [[r, 7] for r in range(9) if r not in (1, 4, 7)]},
        flight={"altitude_m": 15.0, "altitude_step_m": 6.0},
        simulate={"goal": [4, cols - 1], "start_spacing_m": 100.0},
        formation={
            "members": ["uav2", "uav1", "uav3"],
            "shape": {"kind": "line", "spacing_m": 100.0},
            "split_factor": 1.3,
        },
    )
    ui = Ui()
    report = fly(scenario, tmp_path, ui=ui)
    (alpha,) = report.summary["formations"]
    assert alpha["splits"] == 1
    assert [len(coded(ui.said, "uav2", code)) for code in ("splits", "meets")] == [1, 1]
    assert report.summary["separation"]["too_close"] == []
    assert [vehicle["no_fly_cells_entered"] for vehicle in report.summary["vehicles"]] == [0, 0, 0]
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 3
    for found in filter(None, seen(tmp_path, scenario).values()):
        assert max(row.error_m for row in found[-40:]) < 4.0


@pytest.mark.parametrize("approach", [APPROACHES[0], *full_only(*APPROACHES[1:])])
def test_after_the_leader_lands_the_next_member_leads_within_2_s_and_nobody_stands(
    approach: str, tmp_path: Path
) -> None:
    scenario, ordered_s = group(approach), 45.0
    land, ui = GiveOrder(("uav1",), "land"), Ui()
    report, (answer,) = fly_with_commands(scenario, tmp_path, (ordered_s, land), ui=ui)
    assert {vehicle.outcome for vehicle in answer} == {"taken"}
    rows = seen(tmp_path, scenario)
    for uav in (2, 3):
        later = [row for row in rows[uav] if row.boot_s > ordered_s]
        first = next(row for row in later if row.leader == 2)
        assert first.boot_s - later[0].boot_s <= 2.0
        assert all(row.leader == 2 for row in later[later.index(first) :])
        assert min(row.speed_m_s for row in later if row.boot_s < ordered_s + 15.0) > 1.0
    assert [report.states[uav].outcome for uav in (2, 3)] == [ARRIVED] * 2
    assert report.summary["separation"]["too_close"] == []
    assert coded(ui.said, "uav2", "leaves-group")


@on_each_autopilot(("leader_following", "ardupilot"))
def test_through_a_turn_of_90_degrees_no_member_is_4_m_from_its_place(
    approach: str, autopilot: str, tmp_path: Path
) -> None:
    size, no_fly, goal = turn_cells()
    area = {**AREA, "rows": size, "cols": size, "no_fly": no_fly}
    scenario = group(approach, area=area, simulate={"autopilot": autopilot, "goal": goal})
    report = fly(scenario, tmp_path)
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 3
    for rows in in_place(tmp_path, scenario).values():
        assert max(row.error_m for row in rows) < 4.0


@full
def test_new_weights_in_flight_reach_all_members_the_evidence_and_the_record(tmp_path: Path) -> None:
    scenario, weights = group("behavioural"), {"formation": 1.5, "threat": 0.0}
    command = SetWeights(("uav1",), behaviours=weights)
    report, (answer,) = fly_with_commands(scenario, tmp_path, (45.0, command))
    assert {vehicle.outcome for vehicle in answer} == {"taken"}
    assert {state.membership.weights for state in report.states.values()} == {(1.0, 1.5, 0.0, 1.0)}
    with (tmp_path / FILE_NAME).open("rb") as file:
        asks = [entry.what for entry in check(file).entries if entry.kind == "operator"]
    assert weights in [what.get("behaviours") for what in asks]
    assert all(seen(tmp_path, scenario).values()), "the record replays without a difference"
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 3


@pytest.mark.parametrize("autopilot", ["ardupilot", *full_only("px4")])
def test_a_member_without_the_others_goes_on_by_its_stored_mission(autopilot: str, tmp_path: Path) -> None:
    quiet = [{"uavs": ["uav1", "uav2", "uav3"], "from_s": 35.0}]
    changes = {"simulate": {"autopilot": autopilot}, "communication": {"quiet": quiet}}
    scenario, ui = group(**changes, formation={"alone_after_s": 4.0}), Ui()
    report = fly(scenario, tmp_path, ui=ui)
    assert [state.outcome for state in report.states.values()] == [ARRIVED] * 3
    for uav in (2, 3):
        assert coded(ui.said, f"uav{uav}", "leaves-group")
        sent = sent_to(tmp_path / f"uav{uav}.tlog")
        missions = [m for m in sent if m.get_type() == "MISSION_COUNT" and m.mission_type == MISSION]
        assert len(missions) == 1, "the mission before the launch alone"
        assert sent[-1].get_type() != "SET_POSITION_TARGET_GLOBAL_INT"


def test_the_reference_point_moves_steadily_when_the_route_changes(tmp_path: Path) -> None:
    hostiles = [[ROWS // 2, 6], [ROWS // 2, 9]]
    scenario = group("virtual_structure", threats={"count": 2, "hostiles": hostiles}, planner={"w": 0.9})
    report = fly(scenario, tmp_path)
    assert max(state.membership.n_routes for state in report.states.values()) > 1
    for rows in filter(None, seen(tmp_path, scenario).values()):
        errors = [row.error_m for row in settled(rows, 40.0)]
        assert max(abs(b - a) for a, b in pairwise(errors)) < 3.0
