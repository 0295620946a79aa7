"""A campaign of drawn traffic with light vehicles: no breach of the limits, no deadlock, no wait without end.

`--drawn-traffic 1000` flies that many seeds; docs/limits.md has what was flown.
"""

from __future__ import annotations

from itertools import combinations

import pytest
from drawn_traffic import draw
from profiles import full_only

from swarmctl.agent.phases import Phase
from swarmctl.agent.traffic.intents import REPEAT_EVERY_S
from swarmctl.agent.traffic.separation.clash import find_clashes
from swarmctl.agent.traffic.separation.other_vehicles import KnownFlight
from swarmctl.agent.traffic.separation.trajectory import Trajectory, until_landing

N_DEFAULT, N_FULL = 12, 50
NEWS_S = 20.0
"""time until which messages are lost [s]; the vehicles are on their way then"""

FOUND = (
    29, 58, 64, 73, 103, 112, 118, 139, 171, 191, 195, 218, 287, 312, 314, 337, 377, 490, 500, 538, 546,
    617, 641, 657, 788, 892, 963, 975,
)  # fmt: skip
"""seeds that broke a rule before"""

FOUND_IN_FULL_RUNS = (
    10, 142, 150, 166, 310, 368, 381, 432, 566, 609, 644, 646, 679, 740, 852, 893, 916, 961,
)  # fmt: skip
"""seeds of larger swarms that broke a rule before; each flight takes up to 13 s"""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "seed" in metafunc.fixturenames:
        is_full, n = metafunc.config.getoption("--full"), metafunc.config.getoption("--drawn-traffic")
        seeds = {*range(n or (N_FULL if is_full else N_DEFAULT)), *FOUND}
        metafunc.parametrize("seed", sorted(seeds | {*(FOUND_IN_FULL_RUNS if is_full else ())}))


@pytest.mark.parametrize("quiet_seed", [9, 11, 12, 13, 15, *full_only(*range(9))])
def test_after_all_intents_have_arrived_no_two_flights_conflict(quiet_seed: int) -> None:
    """Earlier intents may be lost or late. `landing_queue` handles descents through another one's height."""
    drawn = draw(quiet_seed)
    swarm = drawn.swarm
    swarm.run(NEWS_S, lambda _now: None)
    swarm.air.loss = 0.0
    swarm.air.mute.clear()
    swarm.run(NEWS_S + 4.0 * REPEAT_EVERY_S, lambda _now: None)
    flown = {agent: agent.state.sent.intent for agent in swarm.agents}
    flights = {
        agent: Trajectory(tuple(t - agent.boot_s for t in flight.times_s), flight.points)
        for agent, flight in ((agent, until_landing(intent)) for agent, intent in flown.items() if intent)
    }
    for one, other in combinations(flights, 2):
        limits = one.task.separation.limits
        known = {other.uav: KnownFlight.predicted(flights[other])}
        # Times are compared by positions up to 0.5 s old.
        clash = all(find_clashes(flights[one].later(late_s), known, limits) for late_s in (-0.6, 0.6))
        if Phase.FLYING in (one.state.phase, other.state.phase):
            assert not clash, (one.uav, drawn.story)


def test_drawn_traffic_keeps_its_limits_and_ends_every_wait(seed: int) -> None:
    drawn = draw(seed).flown()
    assert drawn.findings == [], drawn.story
