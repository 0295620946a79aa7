"""Messages of the members of a formation: to the group alone; the newest counts, and its route stays."""

from __future__ import annotations

import math

import pytest
from node_swarm import COLS, ROWS, UNIX_S, NodeSwarm

from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.core.frames import MemberShared

ROUTE = ((46.0, 14.0), (46.01, 14.0))


def member(lat_deg: float = 46.0, **fields: object) -> MemberShared:
    return MemberShared(lat_deg, 14.0, 340.0, (1.0, 2.0, 0.0), **fields)


def published(swarm: NodeSwarm, *messages: MemberShared, group: tuple[int, ...] = (1, 2, 3)) -> None:
    for message in messages:
        swarm.take(swarm.uavs[1], swarm.uavs[1].node.publish(message, swarm.now, group=group))
        swarm.run(0.1)


def test_only_the_group_within_range_hears_a_member() -> None:
    swarm = NodeSwarm((1, 2, 3, 4), NodeOptions(ROWS, COLS, k=2))
    swarm.run(2.0)
    published(swarm, member(), group=(1, 3, 4))
    heard = {uav: swarm.uavs[uav].node.take_new_members() for uav in swarm.ids}
    assert [uav for uav, new in heard.items() if new] == [3]


def test_the_newest_message_of_a_member_counts_once() -> None:
    swarm = NodeSwarm((1, 2))
    published(swarm, member(46.0), member(46.001))
    first, again = (swarm.uavs[2].node.take_new_members() for _ in range(2))
    message, sent_s = first[1]
    assert (message.lat_deg, again) == (46.001, {})
    assert UNIX_S <= sent_s <= UNIX_S + 0.2


@pytest.mark.parametrize(("route_id", "kept"), [(7, ROUTE), (8, ())])
def test_a_route_holds_until_another_one_is_told(route_id: int, kept: object) -> None:
    swarm = NodeSwarm((1, 2))
    published(swarm, member(route_id=7, route=ROUTE), member(route_id=route_id))
    assert swarm.uavs[2].node.take_new_members()[1][0].route == kept


@pytest.mark.parametrize(
    "fields",
    [
        {"error_m": -1.0},
        {"error_m": math.nan},
        {"age_s": -1.0},
        {"along_m": math.inf},
        {"route": ((91.0, 0.0),)},
    ],
)
def test_impossible_numbers_are_refused(fields: dict[str, object]) -> None:
    """The constructor refuses what a sender may put into a frame, and so does the decoder."""
    with pytest.raises(ValueError, match=r"height|position|age"):
        member(**fields)
