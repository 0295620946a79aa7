"""The observations of one node reach all nodes after any loss, cut, delay or restart."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from node_swarm import COLS, ROWS, UNIX_S, NodeSwarm, at_once
from profiles import examples

from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.node.node import CHECKPOINT_EVERY
from swarmctl.bus.node.replica import COMPACT_AFTER, MAX_INCARNATIONS
from swarmctl.core.frames import IntentPoint, IntentShared, RefusalReason
from swarmctl.core.observation import Observation

IDS = (1, 2, 3, 4, 5)
HEALED_S = 40.0
PHASES = (Phase.explicit, Phase.reuse, Phase.generate)
"""All phases but shrinking, which takes minutes for a history."""

uavs = st.sampled_from(IDS)
cells = st.lists(
    st.tuples(st.integers(0, ROWS - 1), st.integers(0, COLS - 1), st.booleans()),
    min_size=1,
    max_size=9,
    unique_by=lambda cell: cell[:2],
)
Act = Callable[[NodeSwarm], None]


def observes(uav: int, seen: list[tuple[int, int, bool]], times: int) -> Act:
    def act(swarm: NodeSwarm) -> None:
        for _ in range(times):
            swarm.uavs[uav].observe(*seen)

    return act


def starts_again(uav: int) -> Act:
    return lambda swarm: swarm.uavs[uav].start()


def passes(seconds: float) -> Act:
    return lambda swarm: swarm.run(seconds)


def becomes(loss: float, delay_s: float, jitter_s: float, group: frozenset[int], seed: int) -> Act:
    """Make the network lose, delay and reorder messages, with a cut between `group` and the other UAVs."""
    rng = np.random.default_rng(seed)

    def carry(sender: int, to: int, _now_s: float) -> float | None:
        if (sender in group) != (to in group) or rng.random() < loss:
            return None
        return delay_s + jitter_s * float(rng.random())

    def act(swarm: NodeSwarm) -> None:
        swarm.carry = carry

    return act


acts = st.one_of(
    st.builds(observes, uavs, cells, st.integers(1, 4)),
    st.builds(observes, uavs, cells, st.just(CHECKPOINT_EVERY + 3)),
    st.builds(starts_again, uavs),
    st.builds(passes, st.floats(0.1, 8.0)),
    st.builds(
        becomes,
        st.floats(0.0, 1.0),
        st.floats(0.0, 1.0),
        st.floats(0.0, 2.0),
        st.frozensets(uavs),
        st.integers(0, 2**32 - 1),
    ),
)


@given(st.lists(acts, max_size=30), st.sampled_from((None, 1, 2)), st.booleans())
@settings(max_examples=examples(60), deadline=None, phases=PHASES)
def test_all_beliefs_are_equal_after_any_history_that_ends_connected(
    history: list[Act], k: int | None, relay: bool
) -> None:
    swarm = NodeSwarm(IDS, NodeOptions(ROWS, COLS, k=k, relay=relay, round_trip_s=6.0))
    for act in history:
        act(swarm)
    becomes(0.0, 0.05, 0.0, frozenset(), 0)(swarm)
    swarm.run(HEALED_S * (1 if k is None else 3))
    assert swarm.agree()
    # Messages from before a restart of their sender have been overtaken.
    assert all(uav.node.counters.refused.keys() <= {RefusalReason.REPLAY} for uav in swarm.uavs.values()), (
        swarm.said
    )


@given(st.lists(acts, max_size=30))
@settings(max_examples=examples(30), deadline=None, phases=PHASES)
def test_beliefs_have_only_observed_cells(history: list[Act]) -> None:
    swarm = NodeSwarm(IDS)
    seen: set[tuple[int, int, bool]] = set()
    for uav in swarm.uavs.values():
        observe = uav.observe
        uav.observe = lambda *c, observe=observe: (seen.update(c), observe(*c))[1]  # type: ignore[method-assign]
    for act in history:
        act(swarm)
    swarm.run(5.0)
    for uav in swarm.uavs.values():
        hits = {(int(r), int(c)) for r, c in np.argwhere(uav.belief.hits > 0)}
        assert hits <= {(r, c) for r, c, occupied in seen if occupied}


def test_a_lost_message_is_requested_after_the_next_one() -> None:
    swarm = NodeSwarm((1, 2), NodeOptions(ROWS, COLS, sync_every_s=1000.0))
    swarm.run(2.0)
    swarm.carry = lambda *_: None
    swarm.uavs[1].observe((0, 0, True))
    swarm.carry = lambda *_: 0.01
    swarm.uavs[1].observe((1, 1, False))
    swarm.run(0.5)
    assert swarm.agree()


def test_the_next_state_reveals_a_lost_last_message() -> None:
    swarm = NodeSwarm((1, 2), NodeOptions(ROWS, COLS, sync_every_s=1000.0))
    swarm.run(2.0)
    swarm.carry = lambda *_: None
    swarm.uavs[1].observe((0, 0, True))
    swarm.carry = lambda *_: 0.01
    swarm.run(1.5)
    assert swarm.agree()


def test_a_late_joiner_gets_all_observations_from_its_first_peer() -> None:
    swarm = NodeSwarm((1, 2, 3), NodeOptions(ROWS, COLS, sync_every_s=1000.0))
    swarm.carry = lambda sender, to, _now: None if 3 in (sender, to) else 0.01
    for row in range(ROWS):
        swarm.uavs[1].observe(*((row, col, (row + col) % 5 == 0) for col in range(COLS)))
    swarm.run(5.0)
    swarm.carry = lambda sender, to, _now: None if 1 in (sender, to) else 0.01
    swarm.uavs[3].start()
    swarm.run(2.0)
    assert np.array_equal(swarm.uavs[3].belief.looks, swarm.uavs[1].belief.looks)
    assert swarm.uavs[2].node.counters.snapshots_served >= 1


def test_an_agent_that_was_restarted_often_still_shares_its_observations() -> None:
    swarm = NodeSwarm((1, 2))
    swarm.incarnations = count(100)
    swarm.uavs[1].start()
    earlier = [Observation(1, 1, 0.0, ((1, 1, True),), n) for n in range(1, MAX_INCARNATIONS + 2)]
    swarm.uavs[1].node.restore((UNIX_S - 60.0, seen) for seen in earlier)
    swarm.uavs[1].observe((2, 2, True))
    swarm.run(2.0)
    assert swarm.uavs[2].belief.hits[2, 2] == 1


def test_a_uav_outside_all_ranges_keeps_requesting() -> None:
    swarm = NodeSwarm((1, 2, 3), NodeOptions(ROWS, COLS, k=1))
    for uav, lat_deg in ((1, 46.0), (2, 46.02), (3, 46.021)):  # 1 sends to 2; 2 and 3 send to each other
        swarm.uavs[uav].where = (lat_deg, 14.0)
    swarm.run(20.0)
    swarm.uavs[2].where = (46.001, 14.0)  # 3 sends to 2, and 2 sends to 1
    swarm.run(5.0)
    swarm.uavs[1].observe((0, 0, True))
    swarm.run(12.0)
    assert swarm.agree()


def test_memory_stays_bounded_in_a_long_flight() -> None:
    swarm = NodeSwarm((1, 2, 3))
    n = 4 * COMPACT_AFTER
    for i in range(n):
        for uav in swarm.uavs.values():
            uav.observe((i % ROWS, uav.uav, i % 3 == 0), (i % ROWS, uav.uav + 4, False))
        swarm.run(0.2)
    swarm.run(5.0)
    assert swarm.agree()
    most = 3 * (COMPACT_AFTER + 2 * CHECKPOINT_EVERY)
    for uav in swarm.uavs.values():
        assert uav.belief.looks.sum() == 3 * 2 * n
        assert len(list(uav.belief.items())) <= most
    # A late joiner gets the whole belief, but not the whole history.
    swarm.carry = lambda sender, to, _now: None if {sender, to} & {1} else 0.01
    sent_before = swarm.uavs[2].node.counters.sent_bytes
    swarm.uavs[3].start()
    swarm.run(2.0)
    assert np.array_equal(swarm.uavs[3].belief.looks, swarm.uavs[2].belief.looks)
    assert swarm.uavs[2].node.counters.sent_bytes - sent_before < 200 * most


def test_a_checkpoint_without_new_observations_reaches_the_agent_later() -> None:
    swarm = NodeSwarm((1, 2))
    for i in range(2 * COMPACT_AFTER):
        swarm.uavs[1].observe((i % ROWS, i % COLS, False))
        swarm.run(0.1)
        before = swarm.uavs[2].belief
        swarm.run(0.1)
        assert swarm.uavs[2].belief is before
    assert len(list(before.items())) < 2 * COMPACT_AFTER


def test_separated_groups_exchange_observations_after_their_reunion() -> None:
    swarm = NodeSwarm((1, 2, 3, 4), NodeOptions(ROWS, COLS, k=1))
    swarm.run(20.0)
    swarm.carry = lambda sender, to, _now: None if (sender <= 2) != (to <= 2) else 0.01
    swarm.run(60.0)
    swarm.uavs[1].observe((0, 0, True))
    swarm.uavs[4].observe((4, 4, True))
    swarm.carry = lambda *_: 0.01
    swarm.run(20.0)
    assert swarm.agree()


def test_lost_observations_stay_lost_without_sync() -> None:
    swarm = NodeSwarm((1, 2), NodeOptions(ROWS, COLS, sync_every_s=0.0))
    swarm.carry = lambda *_: None
    swarm.uavs[1].observe((0, 0, True))
    swarm.carry = lambda *_: 0.01
    swarm.uavs[1].observe((1, 1, True))
    swarm.run(60.0)
    assert swarm.uavs[2].belief.looks.sum() == 1
    assert swarm.uavs[2].node.counters.sent.keys() == {"inform/state"}


def test_a_swarm_with_range_0_sends_nothing() -> None:
    swarm = NodeSwarm(IDS, NodeOptions(ROWS, COLS, k=0))
    swarm.uavs[1].observe((0, 0, True))
    swarm.run(30.0)
    assert sum(u.node.counters.sent.total() for u in swarm.uavs.values()) == 0


@pytest.mark.parametrize("relay", [False, True])
def test_relaying_reaches_uavs_beyond_the_observers_range_at_once(relay: bool) -> None:
    swarm = NodeSwarm((1, 2, 3), NodeOptions(ROWS, COLS, k=1, relay=relay, sync_every_s=4.0))
    for uav, lat_deg in ((1, 46.0), (2, 46.01), (3, 46.015)):  # 1 reaches 2, which reaches 3
        swarm.uavs[uav].where = (lat_deg, 14.0)
    swarm.run(30.2)
    swarm.uavs[1].observe((0, 0, True))
    swarm.run(0.3)
    assert swarm.uavs[2].belief.looks.sum() == 1
    assert swarm.uavs[3].belief.looks.sum() == relay
    swarm.run(20.0)
    assert swarm.agree()


# --- intents


def intent(plan_id: int) -> IntentShared:
    return IntentShared(plan_id, (IntentPoint(0.0, 46.0, 14.0, 330.0), IntentPoint(9.0, 46.01, 14.0, 330.0)))


def shares_intent(swarm: NodeSwarm, uav: int, plan_id: int) -> None:
    sender = swarm.uavs[uav]
    swarm.take(sender, sender.node.publish(intent(plan_id), swarm.now))


def known(swarm: NodeSwarm, uav: int) -> dict[int, int]:
    """Return the plan ids of the other UAVs in the node's new intents."""
    return {other: intent.plan_id for other, (_, intent) in swarm.uavs[uav].node.take_new(IntentShared)}


def test_all_receivers_keep_the_newest_intent() -> None:
    swarm = NodeSwarm((1, 2, 3))
    delays = iter((2.0, 2.0, 0.1, 0.1))
    swarm.carry = lambda sender, _to, _now: next(delays) if sender == 1 else 0.1
    shares_intent(swarm, 1, 5)
    swarm.now_s += 0.5
    shares_intent(swarm, 1, 6)
    swarm.carry = at_once
    swarm.run(3.0)
    ((_, (sent_s, intent)),) = swarm.uavs[2].node.take_new(IntentShared)
    assert intent.plan_id == 6
    assert sent_s == pytest.approx(UNIX_S + 0.5)
    assert known(swarm, 3) == {1: 6}
    assert known(swarm, 3) == {}


def test_snapshots_have_intents() -> None:
    swarm = NodeSwarm((1, 2, 3))
    swarm.carry = lambda sender, to, _now: None if {sender, to} == {1, 3} else 0.01
    swarm.uavs[1].observe((0, 0, True))
    swarm.run(2.0)
    shares_intent(swarm, 1, 5)
    swarm.run(1.0)
    swarm.uavs[3].start()
    swarm.run(8.0)
    assert known(swarm, 3) == {1: 5}
