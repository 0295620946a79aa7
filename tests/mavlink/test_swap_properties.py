"""Swaps of each kind over wires that lose, double, delay and fail: no mixture, no false report.

At the end the vehicle holds the mission that the ground station reports, also after a reboot or an
outage during the swap.
"""

from __future__ import annotations

from typing import Any

import pytest
from flying_bench import Faults, FlyingBench, is_partial_list, plan, wires
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.mission import MissionItem
from swarmctl.mavlink.procedures import basic

OLD, NEW, NEWER = plan(north=8), plan(north=6, east=0.001, alt=33.333), plan(north=7, east=-0.001)
Items = tuple[MissionItem, ...]
KINDS = ["at once", "behind", "in place"]
MODEST = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))

outages = st.lists(
    st.tuples(st.floats(0.0, 6.0), st.sampled_from([0.3, 2.0, 12.0])).map(lambda o: (o[0], o[0] + o[1])),
    max_size=2,
)


def flying(way: str) -> FlyingBench:
    """Return a flying vehicle with that kind of swap."""
    bench = FlyingBench("px4" if way == "at once" else "ardupilot").flying(OLD)
    if way == "in place":
        # This firmware does not answer partial lists, so the vehicle has to hold.
        bench.block = is_partial_list
    return bench


class MissionMonitor:
    """Check of the missions that a vehicle holds and flies while one plan replaces another."""

    def __init__(self, bench: FlyingBench, new: Items) -> None:
        self._bench = bench
        self._first = bench.session.dialect.first_waypoint_seq
        self.old, self.new = bench.session.items, new
        self.behind = self.old + new[self._first :]
        self.mixtures_s: list[float] = []

    def _flies(self, whole: Items, begin: int, end: int) -> bool:
        """Return true if the vehicle holds `whole` up to `end` and flies an item from `begin` to `end`.

        Item 0 is home, or a take-off that lies where the vehicle was during the swap.
        """
        bench = self._bench
        same = bench.session.dialect.differences(whole[1:end], bench.stored[1:end], 1) == ()
        return same and begin <= bench.vehicle.mission.index < end

    def flies_old(self) -> bool:
        return self._flies(self.old, 0, len(self.old))

    def flies_new(self) -> bool:
        return self._flies(self.new, self._first, len(self.new)) or self._flies(
            self.behind, len(self.old), len(self.behind)
        )

    def watch(self) -> None:
        """Note the time if the vehicle flies a mixture of the plans, or to a place of neither."""
        bench = self._bench
        in_mission = bench.vehicle.armed and bench.mode == bench.session.dialect.mission_mode
        is_mixture = in_mission and not (self.flies_old() or self.flies_new())
        if is_mixture or bench.aim not in {None, *((i.x, i.y) for i in (*self.old, *self.new))}:
            self.mixtures_s.append(bench.now)


def swapped(bench: FlyingBench, wire: Faults, cuts: list[tuple[float, float]]) -> tuple[MissionMonitor, Any]:
    """Return the monitor and the result of a swap over that wire, without a mixture at any time."""
    monitor = MissionMonitor(bench, bench.session.mission_items(NEW))
    bench.spoil(wire, *cuts)
    bench.begin_swap(NEW)
    assert bench.run(900, lambda: monitor.watch() or bench.session.busy_with is None), "the swap does not end"
    result = bench.result
    bench.heal()
    bench.run(3.0, monitor.watch)  # the last messages arrive
    assert monitor.mixtures_s == []
    return monitor, result


def agrees(bench: FlyingBench, result: basic.Swapped) -> bool:
    """Return true if the vehicle holds the mission that the ground station reports.

    A ground station without a known mission must not claim that the new one is flown.
    """
    assert (result.failure is None) == (result.flying == "new")
    return bench.holds(bench.session.items) if bench.session.items else result.flying != "new"


@pytest.mark.parametrize("way", KINDS)
@settings(MODEST, max_examples=examples(8, 4))
@given(wire=wires, cuts=outages)
def test_a_swap_never_flies_a_mixture_and_reports_its_result_truly(way, wire, cuts):
    bench = flying(way)
    monitor, result = swapped(bench, wire, cuts)
    assert agrees(bench, result)
    if not bench.vehicle.armed:
        return  # the vehicle has landed at the end of one of the plans
    if result.flying == "new":
        assert monitor.flies_new()
    if result.flying == "old":
        assert monitor.flies_old()
    if result.flying == "hold":
        assert bench.mode == bench.session.dialect.hold_mode


@pytest.mark.parametrize("way", KINDS)
@settings(MODEST, max_examples=examples(6, 3))
@given(wire=wires, after_s=st.floats(0.0, 3.0), silence_s=st.sampled_from([0.5, 1.5, 8.0]))
def test_a_vehicle_that_reboots_in_a_swap_is_not_reported_as_flying(way, wire, after_s, silence_s):
    """A reboot stops the motors and keeps the mission. The next swap fails and reports the reason."""
    bench = flying(way)
    bench.spoil(wire)
    bench.begin_swap(NEW)
    bench.run(after_s)
    under_way = bench.session.busy_with is not None
    bench.inject(f"reboot:silence_s={silence_s}")
    assert bench.run(900, lambda: bench.session.busy_with is None), "the swap does not end"
    result = bench.result
    bench.heal()
    bench.run(silence_s + 10.0)
    if under_way:
        assert result.flying in ("unknown", "hold", "theirs", "old"), result
    if bench.session.items:
        assert bench.holds(bench.session.items)
    again = bench.swap(NEW)
    assert "[not-flying]" in again.failure or "[taken-over]" in again.failure
    assert not bench.vehicle.armed


@pytest.mark.parametrize("way", KINDS)
@settings(MODEST, max_examples=examples(5, 3))
@given(wire=wires, pause_s=st.sampled_from([0.0, 0.4, 3.0]))
def test_successive_swaps_do_not_mix_their_items(way, wire, pause_s):
    """An agent uploads the newest plan at the end of each swap, after success or failure."""
    bench = flying(way)
    bench.spoil(wire)
    for new in (NEW, NEWER):
        bench.run(pause_s)
        result = bench.swap(new)
    bench.heal()
    bench.run(3.0)
    assert agrees(bench, result)
    if result.flying == "new" and bench.vehicle.armed:
        tail = bench.session.mission_items(NEWER)[bench.session.dialect.first_waypoint_seq :]
        held = bench.stored[-len(tail) :]
        assert bench.session.dialect.differences(tail, held, len(bench.stored) - len(tail)) == ()
        assert bench.vehicle.mission.index >= len(bench.stored) - len(tail)


@pytest.mark.full
@pytest.mark.parametrize("way", KINDS)
@pytest.mark.parametrize("end_s", [0.05, 0.1, 0.2, 0.4, 0.8])
def test_a_lost_link_in_a_swap_leaves_a_whole_plan(way, end_s):
    """After any last message the vehicle flies one plan to its end or holds."""
    bench = flying(way)
    monitor = MissionMonitor(bench, bench.session.mission_items(NEW))
    bench.spoil(Faults(max_delay_s=0.05, seed=5), (end_s, 1e9))
    bench.begin_swap(NEW)
    landed = bench.run(300, lambda: monitor.watch() or not bench.vehicle.armed)
    assert monitor.mixtures_s == []
    if not landed:
        assert way == "in place"
        assert bench.mode == bench.session.dialect.hold_mode
        return
    goals = [(p.landing.lat_deg, p.landing.lon_deg) for p in (OLD, NEW)]
    assert any(bench.vehicle.body.lat_lon_deg == pytest.approx(goal, abs=2e-5) for goal in goals)
