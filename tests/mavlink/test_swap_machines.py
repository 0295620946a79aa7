"""The machines of the swaps with a drawn vehicle: each stays in its table and ends with a true outcome."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import pytest
from drawn_vehicle import START, drawn_swap
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.mavlink.procedures.swap import append, atomic, choice, in_hold, machine
from swarmctl.mavlink.protocol.conversation import IllegalEvent

MACHINES = (atomic.AtomicSwap, append.AppendSwap, in_hold.SwapInHold)


@settings(max_examples=examples(3000, 300), deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32))
def test_a_drawn_swap_ends_by_its_table_with_a_true_outcome(seed: int) -> None:
    vehicle, plan = drawn_swap(seed)
    new = vehicle.dialect.mission_items(plan, START)
    done = vehicle.perform(choice.swap(vehicle.context, plan))  # raises IllegalEvent outside of a table
    assert (done.failure is None) == (done.flying == "new") == (done.took_s is not None)
    if done.flying == "new":
        known = vehicle.context.verified_items[vehicle.dialect.first_waypoint_seq - len(new) :]
        places = [[(item.command, item.x, item.y) for item in items] for items in (new[-len(known) :], known)]
        assert places[0] == places[1]


@pytest.mark.full
def test_drawn_swaps_pass_every_transition_of_every_table(monkeypatch: pytest.MonkeyPatch) -> None:
    passed = defaultdict[type, set[tuple[str, str]]](set)
    tables: dict[type, Any] = {}

    def record(of: Any, before: str, after: str, may_follow: Any) -> None:
        passed[type(of)].add((before, after))
        tables[type(of)] = of.table()
        assert after in may_follow

    monkeypatch.setattr(machine, "check_transition", record)
    for seed in range(2000):
        vehicle, plan = drawn_swap(seed)
        vehicle.perform(choice.swap(vehicle.context, plan))
    for kind in MACHINES:
        rows = {(state, after) for state, (_, may_follow) in tables[kind].items() for after in may_follow}
        assert passed[kind] == rows, kind


def test_a_step_beside_its_table_names_both_states() -> None:
    class Wrong(atomic.AtomicSwap):
        def _upload(self) -> Any:
            yield from ()
            return atomic.State.RESTORING

    vehicle, plan = drawn_swap(0)
    items = vehicle.dialect.mission_items(plan, START)
    old = machine.OldPlan.of(vehicle.context)
    swap = machine.Swap(vehicle.context, plan, items, old.progress, set())
    with pytest.raises(IllegalEvent, match=f"{atomic.State.RESTORING}.*{atomic.State.UPLOADING}"):
        vehicle.perform(Wrong(swap, old).run())
