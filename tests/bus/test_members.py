"""Messages of the members of a formation: to the group alone; the newest counts, and its route stays."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import pytest
from node_swarm import COLS, ROWS, UNIX_S, NodeSwarm

from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.core.frames import Frame, FrameCodec, MemberShared, MessageRefused, RefusalReason
from swarmctl.core.split import SplitShared

ROUTE = ((46.0, 14.0), (46.01, 14.0))
SPLIT = SplitShared(100.0, 900.0, ((2, ROUTE), (3, ROUTE)))


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
    heard = {uav: swarm.uavs[uav].node.take_new(MemberShared) for uav in swarm.ids}
    assert [uav for uav, new in heard.items() if new] == [3]


def test_the_newest_message_of_a_member_counts_once() -> None:
    swarm = NodeSwarm((1, 2))
    published(swarm, member(46.0), member(46.001))
    ((uav, (sent_s, message)),), again = (swarm.uavs[2].node.take_new(MemberShared) for _ in range(2))
    assert (uav, message.lat_deg, again) == (1, 46.001, [])
    assert UNIX_S <= sent_s <= UNIX_S + 0.2


@pytest.mark.parametrize(("route_id", "kept"), [(7, (ROUTE, SPLIT)), (8, ((), None))])
def test_a_route_with_its_split_holds_until_another_one_is_told(route_id: int, kept: object) -> None:
    swarm = NodeSwarm((1, 2))
    published(swarm, member(route_id=7, route=ROUTE, split=SPLIT), member(route_id=route_id))
    ((_, (_, message)),) = swarm.uavs[2].node.take_new(MemberShared)
    assert (message.route, message.split) == kept


@pytest.mark.parametrize(
    ("begin_m", "end_m", "points"),
    [
        (-math.inf, 10.0, ROUTE),
        (10.0, 10.0, ROUTE),
        (0.0, math.inf, ROUTE),
        (math.nan, 10.0, ROUTE),
        (0.0, 10.0, ((91.0, 0.0),)),
        (0.0, 10.0, ROUTE * 600),
    ],
)
def test_an_impossible_split_is_refused(begin_m: float, end_m: float, points: Any) -> None:
    with pytest.raises(ValueError, match=r"split|position"):
        SplitShared(begin_m, end_m, ((2, points),))


@pytest.mark.parametrize("split", [[0.0, 10.0, [[2, []]]], [10.0, 0.0, []]])
def test_a_frame_with_a_malformed_split_is_refused(split: Any) -> None:
    codec = FrameCodec("small")
    data = codec.encode(Frame(1, 1, 1, UNIX_S, member(route_id=7, route=ROUTE, split=SPLIT)))
    assert codec.decode(data).content.split == SPLIT
    frame = msgspec.msgpack.decode(data[2:])
    frame["content"]["split"] = split
    with pytest.raises(MessageRefused) as refused:
        codec.decode(data[:2] + msgspec.msgpack.encode(frame))
    assert refused.value.why is RefusalReason.MALFORMED
