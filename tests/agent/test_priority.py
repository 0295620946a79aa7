"""The rule of priority: one of two vehicles gives way, and the pages show the rule that the agents apply."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from swarmctl.agent.traffic.priority import Activity, Standing, activity_of, gives_way
from swarmctl.agent.traffic.wait import RULES

PAGE = Path(__file__).parents[2] / "docs" / "traffic.md"

standings = st.builds(
    Standing, st.sampled_from(Activity), st.booleans(), st.integers(1, 254), st.floats(0.0, 40.0)
)


@given(st.lists(standings, min_size=2, max_size=3, unique_by=lambda s: s.uav))
def test_exactly_one_vehicle_of_two_gives_way_if_one_can(swarm: list[Standing]) -> None:
    for one, other in permutations(swarm, 2):
        is_possible = one.can_yield or other.can_yield
        assert (gives_way(one, other) != gives_way(other, one)) is is_possible
        assert not (gives_way(one, other) and not one.can_yield)


@given(st.sampled_from(Activity), st.lists(st.integers(1, 254), min_size=2, max_size=5, unique=True))
def test_of_equal_vehicles_the_lowest_system_id_has_priority(activity: Activity, uavs: list[int]) -> None:
    swarm = [Standing(activity, True, uav) for uav in uavs]
    first = [one.uav for one in swarm if not any(gives_way(one, other) for other in swarm if other != one)]
    assert first == [min(uavs)]


def test_of_two_landing_vehicles_the_lower_one_lands_first() -> None:
    lower, higher = Standing(Activity.LANDING, True, 9, 12.0), Standing(Activity.LANDING, True, 1, 16.0)
    assert gives_way(higher, lower)


def test_a_vehicle_that_waits_on_the_ground_gives_way_to_one_in_flight() -> None:
    waits, flies = (Standing(activity_of(phase), True, uav) for uav, phase in ((1, "standby"), (9, "flying")))
    assert gives_way(waits, flies)


def _rows(heading: str) -> list[list[str]]:
    lines = PAGE.read_text().split(f"\n## {heading}\n")[1].split("\n## ")[0].splitlines()
    table = [line for line in lines if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[2:]]


def test_the_page_shows_every_wait() -> None:
    shown = [row[:3] for row in _rows("Waits")]
    for purpose, rule in RULES.items():
        longest = (
            "the start time of the recall" if rule.longest_s == float("inf") else f"{rule.longest_s:g} s"
        )
        assert [
            f"clear {purpose}" if purpose != "turn" else "turn",
            rule.where,
            longest,
        ] in shown
