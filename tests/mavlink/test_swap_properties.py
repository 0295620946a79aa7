"""Swaps over wires that lose, double, delay and fail, on both kinds of autopilot: no mixture, no untruth."""

from __future__ import annotations

from typing import Any

import pytest
from bench import Faults
from flying_bench import FlyingBench, plan
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink import procedures

OLD, NEW = plan(north=8), plan(north=6, east=0.001, alt=33.333)
Items = tuple[MissionItem, ...]

wires = st.builds(
    Faults,
    loss=st.sampled_from([0.0, 0.05, 0.2, 0.4]),
    doubling=st.sampled_from([0.0, 0.1, 0.5]),
    max_delay_s=st.sampled_from([0.0, 0.1, 0.3, 1.5]),
    seed=st.integers(0, 2**16),
)
outages = st.lists(
    st.tuples(st.floats(0.0, 6.0), st.sampled_from([0.3, 2.0, 12.0])).map(lambda o: (o[0], o[0] + o[1])),
    max_size=2,
)


class Witness:
    """What a vehicle may hold and fly while one plan replaces another."""

    def __init__(self, bench: FlyingBench, new: Items) -> None:
        self._bench = bench
        self._first = bench.session.dialect.first_waypoint_seq
        self.old, self.new = bench.session.items, new
        self.behind = self.old + new[self._first :]

    def _flies(self, whole: Items, begin: int, end: int) -> bool:
        """The vehicle's list begins as `whole` does up to `end`, and its current item is in that part."""
        bench = self._bench
        held = bench.stored[:end]
        same = bench.session.dialect.differences(whole[:end], held) == ()
        return same and begin <= bench.vehicle.mission.index < end

    def flies_old(self) -> bool:
        return self._flies(self.old, 0, len(self.old))

    def flies_new(self) -> bool:
        return self._flies(self.new, self._first, len(self.new)) or self._flies(
            self.behind, len(self.old), len(self.behind)
        )

    def is_in_a_mixture(self) -> bool:
        bench = self._bench
        in_mission = bench.vehicle.armed and bench.mode == bench.session.dialect.mission_mode
        return in_mission and not (self.flies_old() or self.flies_new())

    def aims_elsewhere(self) -> bool:
        aim = self._bench.aim
        return aim is not None and aim not in {(i.x, i.y) for i in (*self.old, *self.new)}


def swapped(bench: FlyingBench, wire: Faults, cuts: list[tuple[float, float]]) -> tuple[Witness, Any]:
    """The swap over that wire, and what was true of the vehicle at every moment of it."""
    new = bench.session.mission_items(NEW)
    witness = Witness(bench, new)
    bad: list[float] = []

    def watch() -> bool:
        if witness.is_in_a_mixture() or witness.aims_elsewhere():
            bad.append(bench.now)
        return bench.session.busy_with is None

    bench.spoil(wire, *cuts)
    bench.begin("swap", lambda c: procedures.swap(c, new))
    assert bench.run(900, watch), "the swap does not end"
    result = bench.session.result
    bench.heal()
    bench.run(3.0, lambda: watch() and False)  # what is still on its way arrives
    assert bad == []
    return witness, result


@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
@settings(
    max_examples=12, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.data_too_large]
)
@given(wire=wires, cuts=outages)
def test_a_swap_never_flies_a_mixture_and_tells_the_truth(personality, wire, cuts):
    bench = FlyingBench(personality).flying(OLD)
    witness, result = swapped(bench, wire, cuts)
    assert (result.failure is None) == (result.flying == "new")
    if bench.session.items:
        assert bench.holds(bench.session.items), "what it holds is what the ground station says"
    if not bench.vehicle.armed:
        return  # it has landed at the end of one of them meanwhile
    if result.flying == "new":
        assert witness.flies_new()
    if result.flying == "old":
        assert witness.flies_old()
    if result.flying == "hold":
        assert bench.mode == bench.session.dialect.hold_mode


@pytest.mark.parametrize("personality", ["ardupilot", "px4"])
@pytest.mark.parametrize("end_s", [0.05, 0.1, 0.2, 0.4, 0.8])
def test_a_link_that_dies_for_good_in_a_swap_leaves_a_whole_plan(personality, end_s):
    """Whatever the last message was that got through, the vehicle flies one plan to its end."""
    bench = FlyingBench(personality).flying(OLD)
    new = bench.session.mission_items(NEW)
    witness = Witness(bench, new)
    bench.spoil(Faults(max_delay_s=0.05, seed=5), (end_s, 1e9))
    bench.begin("swap", lambda c: procedures.swap(c, new))
    mixtures = []

    def down() -> bool:
        if witness.is_in_a_mixture() or witness.aims_elsewhere():
            mixtures.append(bench.now)
        return not bench.vehicle.armed

    assert bench.run(300, down)
    assert mixtures == []
    goals = [(p.landing.lat_deg, p.landing.lon_deg) for p in (OLD, NEW)]
    assert any(bench.vehicle.body.lat_lon_deg == pytest.approx(goal, abs=2e-5) for goal in goals)
