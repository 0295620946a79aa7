"""Renewal of a mesh node's session: links and missing routes over time."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from swarmctl.bus.transports.renewal import (
    MAX_DOUBLINGS,
    MAX_ROUTE_WAIT_S,
    MIN_ROUTE_WAIT_S,
    RESET_AFTER_S,
    LinkSet,
    MeshNeighbours,
    Renewal,
    route_wait_s,
)

SOON, LATE = "0000aa", "ffffbb"
"""Ids of the nodes with the shortest and the longest wait."""


def test_a_neighbour_without_routes_causes_a_renewal_after_a_wait() -> None:
    renewal = Renewal()
    missing = {"2": True, "3": False}
    assert not renewal.is_due(SOON, missing, 100.0, is_missed=False)
    assert not renewal.is_due(SOON, missing, 100.0 + MIN_ROUTE_WAIT_S - 0.1, is_missed=False)
    assert renewal.is_due(SOON, missing, 100.0 + MIN_ROUTE_WAIT_S, is_missed=False)


def test_routes_in_time_restart_the_wait() -> None:
    renewal = Renewal()
    assert not renewal.is_due(SOON, {"2": False}, 100.0, is_missed=False)
    assert not renewal.is_due(SOON, {"2": True}, 101.9, is_missed=False)
    assert not renewal.is_due(SOON, {"2": False}, 102.0, is_missed=False)
    assert not renewal.is_due(SOON, {"2": False}, 103.9, is_missed=False)
    assert renewal.is_due(SOON, {"2": False}, 104.0, is_missed=False)


def test_the_end_of_a_link_causes_no_renewal() -> None:
    renewal = Renewal()
    assert not renewal.is_due(SOON, {"2": False}, 100.0, is_missed=False)
    assert not renewal.is_due(SOON, {}, 101.0, is_missed=False)
    assert not renewal.is_due(SOON, {"2": False}, 103.0, is_missed=False)


def test_a_neighbour_is_requested_to_renew_after_a_renewal_without_effect() -> None:
    renewal = Renewal()
    missing = {"2": False}
    renewal.is_due(SOON, missing, 100.0, is_missed=False)
    assert renewal.unrepaired(missing) == set()
    assert renewal.is_due(SOON, missing, 110.0, is_missed=False)
    assert renewal.unrepaired(missing) == {"2"}
    assert renewal.unrepaired({"2": True}) == set()
    assert not any(renewal.is_due(SOON, missing, 110.0 + s, is_missed=False) for s in range(10_000))


def test_a_missed_node_renews_its_session() -> None:
    renewal = Renewal()
    assert not renewal.is_due(SOON, {"2": True}, 100.0, is_missed=True)
    assert renewal.is_due(SOON, {"2": True}, 100.0 + MIN_ROUTE_WAIT_S, is_missed=True)


def test_renewals_without_effect_become_rarer_until_the_mesh_is_whole() -> None:
    renewal = Renewal()
    times_s = [s for s in range(1000) if renewal.is_due(SOON, {"2": True}, float(s), is_missed=True)]
    waits_s = [later - before for before, later in pairwise(times_s)]
    assert waits_s == sorted(waits_s)
    assert waits_s[-1] >= MIN_ROUTE_WAIT_S * 2**MAX_DOUBLINGS
    for now_s in (1000.0, 1000.0 + RESET_AFTER_S):
        assert not renewal.is_due(SOON, {"2": True}, now_s, is_missed=False)
    assert not renewal.is_due(SOON, {"2": True}, 1020.0, is_missed=True)
    assert renewal.is_due(SOON, {"2": True}, 1020.0 + MIN_ROUTE_WAIT_S, is_missed=True)


@given(st.integers(0, 2**128 - 1))
def test_the_wait_depends_on_the_id(number: int) -> None:
    assert MIN_ROUTE_WAIT_S <= route_wait_s(f"{number:032x}") <= MAX_ROUTE_WAIT_S
    assert route_wait_s(LATE) - route_wait_s(SOON) == MAX_ROUTE_WAIT_S - MIN_ROUTE_WAIT_S


@given(st.lists(st.sampled_from(["", "2", "3", "23"]), max_size=200))
def test_a_whole_network_causes_no_renewal(links: list[str]) -> None:
    """The rule holds for any sequence of links."""
    renewal = Renewal()
    for number, ids in enumerate(links):
        assert not renewal.is_due(SOON, dict.fromkeys(ids, True), float(number), is_missed=False)


def test_a_missed_neighbour_is_requested_until_routes_exist() -> None:
    """Node `1` does not receive the subscription of node `2`."""
    keys_at_1: set[str] = set()
    keys_at_2: set[str] = set()

    def declare_at(keys: set[str]) -> Callable[[str], Callable[[], None]]:
        def declare(key: str) -> Callable[[], None]:
            keys.add(key)
            return lambda: keys.remove(key)

        return declare

    def nowhere(_key: str) -> Callable[[], None]:
        return lambda: None

    renewal_1, renewal_2 = Renewal(), Renewal()
    one = MeshNeighbours("nodes", SOON, declare_at(keys_at_2), keys_at_1.__contains__)
    two = MeshNeighbours("nodes", LATE, nowhere, keys_at_2.__contains__)
    assert not one.has_to_renew(renewal_1, [LATE], 100.0)
    assert one.has_to_renew(renewal_1, [LATE], 100.0 + MIN_ROUTE_WAIT_S)
    assert not two.has_to_renew(renewal_2, [SOON], 102.0)
    assert keys_at_2 == {f"nodes/{SOON}"}
    assert not one.has_to_renew(renewal_1, [LATE], 103.0)
    assert keys_at_2 == {f"nodes/{SOON}", f"nodes/{LATE}/missed"}
    assert not two.has_to_renew(renewal_2, [SOON], 103.0)
    assert two.has_to_renew(renewal_2, [SOON], 103.0 + MAX_ROUTE_WAIT_S)
    keys_at_1.add(f"nodes/{LATE}")
    assert not one.has_to_renew(renewal_1, [LATE], 108.0)
    assert keys_at_2 == {f"nodes/{SOON}"}


def test_a_link_that_is_missing_in_two_lists_has_ended() -> None:
    links = LinkSet()
    links.record(("a", "b"), has_started=True)
    links.record(("a", "c"), has_started=True)
    links.remove_unlisted([("a", "b")])
    assert len(links) == 2
    links.remove_unlisted([("a", "b")])
    assert len(links) == 1
    links.record(("a", "b"), has_started=False)
    assert not links


def test_a_link_that_is_reported_twice_is_one_change() -> None:
    links = LinkSet()
    assert [links.record(("a", "b"), has_started=True) for _ in range(2)] == [True, False]
    assert [links.record(("a", "b"), has_started=False) for _ in range(2)] == [True, False]


def test_a_new_link_may_be_missing_in_one_list() -> None:
    links = LinkSet()
    links.remove_unlisted([])
    links.record(("a", "b"), has_started=True)
    links.remove_unlisted([])
    links.remove_unlisted([("a", "b")])
    links.remove_unlisted([])
    assert len(links) == 1


def test_a_session_without_a_link_is_lost_long_before_zenoh_ends_a_full_link() -> None:
    """The time starts at the first check without a link. Zenoh may need 10 s."""
    links = LinkSet()
    assert [links.are_lost(now_s) for now_s in (10.0, 12.0, 15.0)] == [False, False, True]
    links.record(("a", "b"), has_started=True)
    assert not links.are_lost(30.0)
    links.record(("a", "b"), has_started=False)
    assert [links.are_lost(now_s) for now_s in (32.0, 35.0)] == [False, True]
