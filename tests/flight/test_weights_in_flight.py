"""New weights in flight, the paper's sliders: one agent, and a whole swarm."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from agent_stories import Story, orders
from flights import Ui, coded, fly_with_commands, small
from recorded import effects, events
from rich.console import Console

from swarmctl.agent.phases import Phase
from swarmctl.config.scenario import Scenario
from swarmctl.core import events as ev
from swarmctl.core.exposure import exposure
from swarmctl.core.messages import SetWeights, VehicleAnswer
from swarmctl.core.threat import FiringStrength
from swarmctl.planners import PLANNERS, method
from swarmctl.report import record
from swarmctl.report.answers import weights_line
from swarmctl.report.live_rows import SwarmView, live_table, plain_line, vehicle_row
from swarmctl.report.outcome import FlightReport
from swarmctl.report.summary import MAX_WEIGHTS, FlightStatistics
from swarmctl.report.ui import SafeUi, UiObserver
from swarmctl.station import commands
from swarmctl.station.commands import Answers

STRONGER = FiringStrength(0.9, 0.8, 0.7)
HOSTILE = (4, 3, True)
"""in the way of the straight route along row 4"""


def answer_to(effects: list[ev.Effect], command: int) -> VehicleAnswer:
    (answer,) = (e for e in effects if isinstance(e, ev.Answer))
    assert answer.request_id == command
    return answer.answer


def test_w_takes_effect_on_the_next_plan() -> None:
    story = Story(w=0.0).flying()
    story.hear(HOSTILE)
    assert story.tick() == []  # the shortest route is still the shortest
    answer = answer_to(story(ev.WeightsChanged(7, w=1.0)), 7)
    assert (answer.uav, answer.outcome, answer.from_plan) == (1, "taken", 2)
    swap = story.swap()
    assert swap.plan_id == 2
    assert (4, 3) not in swap.cells
    assert swap.cost == pytest.approx(swap.exposure_sum)  # Eq. 5 at w = 1
    story.accept()
    assert story.state.plans.replans == 1


def test_firing_strengths_take_effect_on_the_next_plan() -> None:
    story = Story().flying()
    story(ev.WeightsChanged(1, strength=STRONGER))
    story.tick()
    assert story.state.plans.exposure is not None
    expected = exposure(story.state.belief.occupancy(), STRONGER)
    assert story.state.plans.exposure == pytest.approx(expected)
    assert story.state.w == 0.5


def test_omitted_weights_keep_their_earlier_changes() -> None:
    story = Story().flying()
    story(ev.WeightsChanged(1, w=0.2))
    story(ev.WeightsChanged(2, strength=STRONGER))
    assert (story.state.w, story.state.strength) == (0.2, STRONGER)


def test_the_task_and_psi_are_unchanged() -> None:
    story = Story().flying()
    before = story.state.task
    story(ev.WeightsChanged(1, w=0.2, strength=STRONGER))
    story.tick()
    assert story.state.task is before


def test_a_pending_plan_is_kept_and_the_next_one_has_the_new_weights() -> None:
    story = Story(w=0.5).flying()
    story.hear(HOSTILE)
    assert story.swap().plan_id == 2
    answer = answer_to(story(ev.WeightsChanged(1, w=0.0)), 1)
    assert answer.from_plan == 3
    assert story.tick() == []
    story.accept()
    story.now += 2.0
    story.over((4, 0))  # the vehicle has followed its plan meanwhile
    swap = story.swap()
    assert swap.plan_id == 3
    assert swap.length_m == 8 * 50.0


def test_flown_exposure_counts_as_believed_at_the_decision() -> None:
    story = Story().flying()
    assert story.state.plans.exposure is not None
    at_decision = float(story.state.plans.exposure[4, 1])
    story(ev.WeightsChanged(1, strength=STRONGER))  # without a later decision
    story.over((4, 1))
    assert story.state.flown.exposure == pytest.approx(at_decision)


def test_weights_that_change_no_route_swap_no_mission() -> None:
    story = Story().flying()
    story(ev.WeightsChanged(1, w=0.4))
    searches = story.state.plans.searches
    assert story.tick() == []
    assert story.state.plans.searches == searches + 1


def test_equal_weights_bring_no_plan() -> None:
    story = Story(w=0.5).flying()
    searches = story.state.plans.searches
    answer = answer_to(story(ev.WeightsChanged(1, w=0.5)), 1)
    assert answer.outcome == "taken"
    assert answer.note.endswith("[unchanged]")
    assert story.tick() == []
    assert story.state.plans.searches == searches


def test_before_the_launch_the_mission_is_uploaded_again() -> None:
    story = Story(w=0.0)
    story.hear(HOSTILE)
    story(ev.Ready())
    story.swap()
    story.accept()
    assert story.state.phase is Phase.STANDBY
    assert answer_to(story(ev.WeightsChanged(1, w=1.0)), 1).from_plan == 2
    assert (4, 3) not in story.swap().cells
    assert orders(story.accept()) == []
    assert story.state.phase is Phase.STANDBY


@pytest.mark.parametrize("name", [name for name, planner in PLANNERS.items() if not planner.USES_W])
def test_a_planner_without_w_refuses_a_change_of_w(name: str) -> None:
    story = Story(method=method(name, PLANNERS[name], {})).flying()
    before = story.state
    for strength in (None, STRONGER):
        answer = answer_to(story(ev.WeightsChanged(3, w=0.2, strength=strength)), 3)
        assert answer.outcome == "refused"
        assert answer.note.endswith("[w-unused]")
        assert name in answer.note
        line = weights_line(0.2, strength, answer)
        assert line.startswith("uav1: ")
        assert line.endswith(answer.note)
        assert "0.2" not in line
        assert story.state == before
    assert answer_to(story(ev.WeightsChanged(4, strength=STRONGER)), 4).outcome == "taken"


def test_weights_during_a_lost_link_apply_after_the_link_is_restored() -> None:
    story = Story().flying()
    story(ev.LinkLost(4.0))
    answer = answer_to(story(ev.WeightsChanged(1, w=1.0)), 1)
    assert answer.outcome == "taken"
    assert "[waits-for-link]" in answer.note
    assert story.tick() == []
    story(ev.LinkRestored())
    searches = story.state.plans.searches
    story.tick()
    assert story.state.plans.searches == searches + 1


def arrived(story: Story) -> None:
    story.over((4, 8))
    story.over((4, 8), armed=False)


@pytest.mark.parametrize(
    ("what_happens", "phase", "why"),
    [
        (lambda s: s.over((4, 8)), "landing", "landing"),
        (arrived, "done", "arrived"),
        (lambda s: s(ev.OperatorCommand(ev.FlightOrder.HOLD)), "holding", "hold ordered"),
        (lambda s: s(ev.OperatorCommand(ev.FlightOrder.RETURN)), "leaving", "return ordered"),
        (lambda s: s.over((4, 1), mode="LOITER", mode_role="other"), "released", "LOITER"),
    ],
    ids=["landing", "arrived", "holding", "returning", "taken over by a pilot"],
)
def test_a_vehicle_that_plans_no_more_refuses_weights_with_a_reason(
    what_happens: Any, phase: str, why: str
) -> None:
    story = Story().flying()
    what_happens(story)
    assert story.state.phase == phase
    before = story.state
    answer = answer_to(story(ev.WeightsChanged(1, w=1.0)), 1)
    assert (answer.outcome, answer.from_plan) == ("over", None)
    assert why in answer.note
    assert story.state is before


# --- the operator's view


def test_a_line_shows_the_changed_weights_and_their_first_plan() -> None:
    taken = VehicleAnswer(3, "uav3", "taken", 5)

    def numbers(w: float | None, strength: FiringStrength | None, answer: VehicleAnswer) -> list[str]:
        name, _, text = weights_line(w, strength, answer).partition(": ")
        assert name == "uav3"
        return re.findall(r"[0-9.]+", text)

    assert numbers(0.2, None, taken) == ["0.2", "5"]
    assert numbers(None, STRONGER, taken) == ["0.9", "0.8", "0.7", "5"]
    assert numbers(0.2, STRONGER, taken) == ["0.2", "0.9", "0.8", "0.7", "5"]
    over = VehicleAnswer(3, "uav3", "over", note="done [no-plan]")
    assert numbers(0.2, None, over) == []
    assert weights_line(0.2, None, over).endswith(over.note)


def test_a_vehicle_shows_weights_that_differ_from_the_configuration() -> None:
    story = Story().flying()
    assert ", w " not in plain_line(vehicle_row(story.state, 0.0))
    story(ev.WeightsChanged(1, w=0.2))
    assert ", w 0.2" in plain_line(vehicle_row(story.state, 0.0))
    story(ev.WeightsChanged(1, strength=STRONGER))
    assert ", w 0.2; 0.9/0.8/0.7" in plain_line(vehicle_row(story.state, 0.0))


def shown(story: Story) -> str:
    console = Console(width=100)
    with console.capture() as capture:
        console.print(live_table(SwarmView("small", 1.0, None, [vehicle_row(story.state, 0.0)]), 100, 30))
    return capture.get()


def test_the_live_table_has_a_column_for_changed_weights() -> None:
    story = Story().flying()
    assert "new w" not in shown(story)
    story(ev.WeightsChanged(1, w=0.25))
    assert "new w" in shown(story)
    assert "0.25" in shown(story)


def after(story: Story, event: ev.Event) -> tuple[Any, ...]:
    """Return an observer's arguments for one event."""
    before = story.state
    effects = story(event)
    return before, event, story.state, effects, 0.0


def test_a_change_without_effect_is_neither_shown_nor_kept() -> None:
    story, ui, statistics = Story(w=0.5).flying(), Ui(), FlightStatistics()
    observer = UiObserver(SafeUi(ui), {1: "uav1"})
    for w in (0.2, 0.2, 0.2, 0.5):
        arguments = after(story, ev.WeightsChanged(1, w=w))
        observer.folded(*arguments)
        statistics.folded(*arguments)
    assert ui.said == [weights_line(w, None, VehicleAnswer(1, "uav1", "taken", 2)) for w in (0.2, 0.5)]
    assert [w for _, _, w, _ in statistics.vehicles[1].weights] == [0.2, 0.5]
    assert statistics.vehicles[1].weight_changes == 2


def test_a_refused_change_is_shown() -> None:
    story, ui = Story().flying(), Ui()
    arrived(story)
    UiObserver(SafeUi(ui), {1: "uav1"}).folded(*after(story, ev.WeightsChanged(1, w=0.2)))
    (line,) = coded(ui.said, "uav1", "no-plan")
    assert ui.said == [line]
    assert "arrived" in line


def test_the_last_of_many_changes_are_kept_and_all_are_counted() -> None:
    story, statistics = Story().flying(), FlightStatistics()
    for n in range(MAX_WEIGHTS + 7):
        statistics.folded(*after(story, ev.WeightsChanged(n, w=n / 1000)))
    kept = statistics.vehicles[1].weights
    assert [w for _, _, w, _ in kept] == [n / 1000 for n in range(7, MAX_WEIGHTS + 7)]
    assert statistics.vehicles[1].weight_changes == MAX_WEIGHTS + 7


# --- a whole swarm


@dataclass
class Flown:
    scenario: Scenario
    folder: Path
    report: FlightReport
    answer: Answers
    ui: Ui


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    """Three vehicles on their shortest routes; the first two get w = 1 and no receivers in flight."""
    command = SetWeights((1, 2), w=1.0, range=0, by="ana")
    scenario, folder, ui = small(planner={"w": 0.0}), tmp_path_factory.mktemp("set"), Ui()
    report, (answer,) = fly_with_commands(scenario, folder, (30.0, command), ui=ui)
    return Flown(scenario, folder, report, answer, ui)


@pytest.mark.virtual
def test_routes_change_from_the_answered_plan_on(flown: Flown) -> None:
    psi = flown.scenario.psi_per_cell
    from_plan = {v.uav: v.from_plan for v in flown.answer}
    assert sorted(from_plan) == [1, 2]
    assert {v.outcome for v in flown.answer} == {"taken"}
    changed = 0
    for uav in (1, 2, 3):
        for recorded in effects(flown.folder, "SwapMission", f"uav{uav}"):
            swap = recorded["effect"]["mission"]
            if swap["plan_id"] >= from_plan.get(uav, math.inf):
                assert swap["cost"] == pytest.approx(swap["exposure_sum"])  # Eq. 5 at w = 1
                changed += 1
            else:
                assert swap["cost"] == pytest.approx(psi * swap["length_m"] / 50.0)  # Eq. 5 at w = 0
    assert changed > 0
    assert flown.report.all_arrived


@pytest.mark.virtual
def test_a_vehicle_that_was_not_named_keeps_its_weights(flown: Flown) -> None:
    assert [s.w for s in flown.report.states.values()] == [1.0, 1.0, 0.0]


@pytest.mark.parametrize(("w", "outcome"), [(None, "taken"), (0.2, "over")])
def test_the_range_changes_in_a_vehicle_that_plans_no_more(w: float | None, outcome: str) -> None:
    story = Story(w=0.0).flying()
    story(ev.OperatorCommand(ev.FlightOrder.HOLD, 1))
    effects = story(ev.WeightsChanged(2, w=w, range=1))
    assert answer_to(effects, 2).outcome == outcome
    assert ev.SetRange(1) in effects
    assert story.state.w == 0.0


@pytest.mark.virtual
def test_the_range_of_the_named_vehicles_changes(flown: Flown) -> None:
    heard_s: dict[int, float] = {}
    for received in events(flown.folder, "TelemetryReceived"):
        for uav, *_ in received["event"].get("intents", ()):
            heard_s[uav] = received["now_s"]
    assert max(heard_s[1], heard_s[2]) < 35.0  # nobody receives them any more, 5 s after the change
    assert heard_s[3] > 60.0


@pytest.mark.virtual
def test_the_evidence_names_the_person(flown: Flown) -> None:
    lines = [json.loads(line) for line in (flown.folder / "evidence.jsonl").read_text().splitlines()]
    asked = [line["what"] for line in lines if line["kind"] == "operator"]
    assert [(what["by"], what["range"], what["w"]) for what in asked if "by" in what] == [("ana", 0, 1.0)] * 2


@pytest.mark.virtual
def test_a_replay_with_a_command_makes_the_same_decisions(flown: Flown) -> None:
    verdict = record.replay(flown.folder / "run.mcap")
    assert verdict.difference == ""
    assert verdict.effects > 100


@pytest.mark.virtual
def test_the_summary_has_the_history_of_the_weights(flown: Flown) -> None:
    summary = json.loads((flown.folder / "summary.json").read_text())
    assert summary["operator_commands"] == {"passed_on": 2, "refused": 0}
    first, _, third = (v["weights"] for v in summary["vehicles"])
    strengths = {"direct": 0.6, "first_neighbour": 0.3, "second_neighbour": 0.1}
    began_with = {"flight_time_s": None, "from_plan": 1, "w": 0.0, "firing_strength": strengths}
    assert third == [began_with]
    assert first[0] == began_with
    assert first[1]["w"] == 1.0
    assert [v["weight_changes"] for v in summary["vehicles"]] == [1, 1, 0]
    assert first[1]["from_plan"] == flown.answer[0].from_plan
    assert 0.0 < first[1]["flight_time_s"] < 30.0
    assert flown.report.summary["psi_per_cell"] == flown.scenario.psi_per_cell


@pytest.mark.virtual
def test_the_change_is_shown(flown: Flown) -> None:
    plan = flown.answer[0].from_plan
    assert weights_line(1.0, None, VehicleAnswer(1, "uav1", "taken", plan), 0) in flown.ui.said
    assert [r.weights for r in flown.ui.views[-1].rows] == ["1", "1", ""]


@pytest.mark.full
@pytest.mark.virtual
def test_one_command_changes_all_vehicles_and_names_those_that_have_arrived(tmp_path: Path) -> None:
    command = SetWeights(None, w=0.9)
    scenario = small(simulate={"count": 2, "ready_s": 3.0, "delay_step_s": 60.0})
    _, (answer,) = fly_with_commands(scenario, tmp_path, (110.0, command))
    assert [v.outcome for v in answer] == ["over", "taken"]
    assert not commands.has_failed(command, answer)
    assert commands.has_failed(SetWeights((1, 2), w=0.9), answer)
