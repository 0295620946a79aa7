"""Properties of mission transfers under any order of messages, from two ground stations, with gaps."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from transfer_bench import (
    CIRCLE,
    FENCE,
    GCS,
    MISSION,
    POLYGON,
    RALLY,
    RALLY_POINT,
    Bench,
    ardupilot,
    fields,
    px4,
    square,
    waypoints,
)

from sim_vehicle.vehicle.injected_faults import MissionRefusal

PEERS = [GCS, (250, 190), (1, 191)]
KINDS = [MISSION, FENCE, RALLY, 3, 255]
QUIET_S = 10.0  # longer than either waits for an item

seqs = st.integers(0, 5)
kinds = st.sampled_from(KINDS)
numbers = st.one_of(st.sampled_from([0.0, 1.0, 3.0, 4.0, 20.3, -7.5, float("nan"), float("inf"), 1e38]))
commands = st.sampled_from([16, 20, 21, 22, 93, 112, 177, 178, 2999, POLYGON, CIRCLE, RALLY_POINT])
frames = st.sampled_from([0, 2, 3, 5, 6, 9, 10])


def _item(seq: int, command: int, frame: int, p1: float, p2: float, z: float, current: int, kind: int) -> Any:
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, frame, command, current, seq % 2, p1, p2, 0.0, float("nan"), 460_000_000 + seq, -5, z, kind
    )


def _legacy(seq: int, command: int, frame: int, x: float, z: float, kind: int) -> Any:
    return mavlink.MAVLink_mission_item_message(1, 1, seq, frame, command, 0, 1, 0, 0, 0, 0, x, x, z, kind)


messages = st.one_of(
    st.builds(
        lambda n, k: mavlink.MAVLink_mission_count_message(1, 1, n, k),
        st.sampled_from([0, 1, 2, 3, 4, 700]),
        kinds,
    ),
    st.builds(_item, seqs, commands, frames, numbers, numbers, numbers, st.integers(0, 3), kinds),
    st.builds(_legacy, seqs, commands, frames, numbers, numbers, kinds),
    st.builds(lambda k: mavlink.MAVLink_mission_request_list_message(1, 1, k), kinds),
    st.builds(lambda s, k: mavlink.MAVLink_mission_request_int_message(1, 1, s, k), seqs, kinds),
    st.builds(lambda s, k: mavlink.MAVLink_mission_request_message(1, 1, s, k), seqs, kinds),
    st.builds(lambda k: mavlink.MAVLink_mission_clear_all_message(1, 1, k), kinds),
    st.builds(
        lambda r, k: mavlink.MAVLink_mission_ack_message(1, 1, r, k), st.sampled_from([0, 1, 3, 15]), kinds
    ),
    st.builds(lambda s: mavlink.MAVLink_mission_set_current_message(1, 1, s), seqs),
    st.builds(
        lambda a, b, k: mavlink.MAVLink_mission_write_partial_list_message(1, 1, a, b, k),
        st.integers(-2, 5),
        st.integers(-2, 5),
        kinds,
    ),
)
events = st.lists(
    st.one_of(
        st.tuples(st.just("send"), st.sampled_from(PEERS), messages),
        st.tuples(st.just("wait"), st.sampled_from([0.1, 0.3, 1.1, 6.0]), st.none()),
    ),
    max_size=30,
)


def play(bench: Bench, script: list[Any]) -> None:
    for action, peer_or_wait_s, message in script:
        if action == "wait":
            bench.wait(peer_or_wait_s)
        else:
            bench.send(message, peer_or_wait_s)
        assert bench.machine.next_deadline_s >= bench.now - 1e-6 or not bench.wait(0.05)


@pytest.mark.parametrize("make", [ardupilot, px4], ids=["ardupilot", "px4"])
@settings(derandomize=True, deadline=None, max_examples=examples(60))
@given(script=events)
def test_a_clean_upload_succeeds_after_anything(make: Any, script: list[Any]) -> None:
    bench: Bench = make()
    play(bench, script)
    bench.wait(QUIET_S)
    for items, kind in ((waypoints(4), MISSION), (square(), FENCE), ([fields(0, RALLY_POINT)], RALLY)):
        assert bench.upload(items, kind) == 0
        assert len(bench.download(kind)) == len(items)


@pytest.mark.parametrize(("make", "kept", "told"), [(ardupilot, 1, [("stored", MISSION, 3)]), (px4, 0, [])])
def test_a_fault_refuses_a_mission_at_once_or_at_an_item(make: Any, kept: int, told: list[Any]) -> None:
    bench: Bench = make()
    bench.refusal = MissionRefusal(mavlink.MAV_MISSION_DENIED)
    assert bench.upload(waypoints(3)) == mavlink.MAV_MISSION_DENIED
    bench.refusal = MissionRefusal(mavlink.MAV_MISSION_NO_SPACE, at_item=1)
    assert bench.upload(waypoints(3)) == mavlink.MAV_MISSION_NO_SPACE
    assert len(bench.mission.items) == kept
    bench.refusal = None
    assert bench.upload(waypoints(3)) == mavlink.MAV_MISSION_ACCEPTED
    assert bench.calls[-1:] == told
