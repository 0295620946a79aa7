"""Messages that a node refuses: each refusal is counted by its reason and leaves the belief unchanged."""

from __future__ import annotations

import zlib

import msgspec
import numpy as np
import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st
from node_swarm import COLS, ROWS, UNIX_S, NodeSwarm, state

from swarmctl.bus.node.exchange import Instant, NodeOptions
from swarmctl.bus.node.node import MAX_REFUSED_FRAMES
from swarmctl.bus.node.peer import WORK_BURST, WORK_PER_MESSAGE
from swarmctl.bus.node.replica import MAX_INCARNATIONS
from swarmctl.core.frames import (
    MAX_FRAME_BYTES,
    VERSION,
    Content,
    Frame,
    FrameCodec,
    RefusalReason,
    Relayed,
    Snapshot,
    SnapshotAsked,
    StateShared,
)
from swarmctl.core.observation import Checkpoint, Observation, checkpoint
from swarmctl.core.records import replace

MOST = WORK_BURST // WORK_PER_MESSAGE
"""Messages accepted at once."""


def seen(seq: int = 1, *cells: tuple[int, int, bool], observer: int = 1, incarnation: int = 1) -> Observation:
    return Observation(observer, seq, 0.0, cells or ((1, 1, True),), incarnation)


def frame(
    content: Content, *, sender: int = 1, n: int = 1, unix_s: float = UNIX_S, incarnation: int = 1
) -> Frame:
    return Frame(sender, incarnation, n, unix_s, content)


SEAL = FrameCodec("test")


def padded(content: Content) -> bytes:
    """Return a frame just within the length limit, padded with an unknown field."""
    body = msgspec.msgpack.decode(SEAL.encode(frame(content))[2:])
    body["later"] = bytes(MAX_FRAME_BYTES - 1000)
    return bytes((VERSION, 0)) + msgspec.msgpack.encode(body)


OTHERS_BOMB = checkpoint(None, [Observation(1, 1, 0.0, ((999, 999, True),), 1)], 1000, 10**6)
assert OTHERS_BOMB is not None
EMPTY = Checkpoint(1, 1, 1, zlib.compress(b""), 0)

WRONG: dict[str, tuple[int, str, bytes, RefusalReason]] = {
    "empty": (1, "inform/state", b"", RefusalReason.MALFORMED),
    "no MessagePack": (1, "inform/state", bytes((VERSION, 0)) + b"nonsense", RefusalReason.MALFORMED),
    "a later version": (
        1,
        "inform/state",
        bytes((VERSION + 1,)) + SEAL.encode(frame(state()))[1:],
        RefusalReason.VERSION,
    ),
    "too long": (1, "inform/state", bytes(MAX_FRAME_BYTES + 1), RefusalReason.OVERSIZE),
    "an impossible position": (
        1,
        "inform/state",
        SEAL.encode(frame(state())).replace(msgspec.msgpack.encode(46.0), msgspec.msgpack.encode(460.0)),
        RefusalReason.MALFORMED,
    ),
    "the key of another UAV": (2, "inform/state", SEAL.encode(frame(state())), RefusalReason.SOURCE),
    "another act": (1, "inform/observation", SEAL.encode(frame(state())), RefusalReason.SOURCE),
    "an observation of another UAV as its own": (
        1,
        "inform/observation",
        SEAL.encode(frame(seen(observer=2))),
        RefusalReason.SOURCE,
    ),
    "a minute old": (
        1,
        "inform/state",
        SEAL.encode(frame(state(), unix_s=UNIX_S - 61.0)),
        RefusalReason.REPLAY,
    ),
    "one cell twice": (
        1,
        "inform/observation",
        SEAL.encode(frame(seen(1, (1, 1, True), (1, 1, False)))),
        RefusalReason.MALFORMED,
    ),
    "an impossible height": (
        1,
        "inform/state",
        SEAL.encode(frame(state())).replace(
            msgspec.msgpack.encode(30.0), msgspec.msgpack.encode(float("nan"))
        ),
        RefusalReason.MALFORMED,
    ),
    "an oversized observation": (1, "inform/observation", padded(seen()), RefusalReason.OVERSIZE),
    "a UAV of another swarm": (
        9,
        "inform/state",
        SEAL.encode(frame(state(), sender=9)),
        RefusalReason.STRANGER,
    ),
    "from the future": (
        1,
        "inform/state",
        SEAL.encode(frame(state(), unix_s=UNIX_S + 6.0)),
        RefusalReason.FUTURE,
    ),
    "a cell outside": (
        1,
        "inform/observation",
        SEAL.encode(frame(seen(1, (ROWS, 0, True)))),
        RefusalReason.OUTSIDE,
    ),
    "a checkpoint outside snapshots": (
        1,
        "inform/checkpoint",
        SEAL.encode(frame(EMPTY)),
        RefusalReason.MALFORMED,
    ),
    "cells outside, in a snapshot's checkpoint": (
        1,
        "inform/snapshot",
        SEAL.encode(frame(Snapshot((SEAL.encode(frame(OTHERS_BOMB)),), True), n=2)),
        RefusalReason.OUTSIDE,
    ),
    "a checkpoint that unpacks to gigabytes": (
        1,
        "inform/snapshot",
        SEAL.encode(
            frame(Snapshot((SEAL.encode(frame(Checkpoint(1, 1, 5, zlib.compress(bytes(10**7)), 0))),), True))
        ),
        RefusalReason.OUTSIDE,
    ),
    "a relayed query": (
        1,
        "inform/relayed",
        SEAL.encode(frame(Relayed((SEAL.encode(frame(SnapshotAsked((), ()), sender=3)),)))),
        RefusalReason.MALFORMED,
    ),
    "a relayed observation of an unknown UAV": (
        1,
        "inform/relayed",
        SEAL.encode(frame(Relayed((SEAL.encode(frame(seen(observer=9), sender=9)),)))),
        RefusalReason.STRANGER,
    ),
}


def of(swarm: NodeSwarm, uav: int) -> dict[str, int]:
    return dict(swarm.uavs[uav].node.counters.refused)


@pytest.mark.parametrize(("sender", "act", "data", "why"), WRONG.values(), ids=WRONG)
def test_invalid_messages_are_refused_and_counted(
    sender: int, act: str, data: bytes, why: RefusalReason
) -> None:
    swarm = NodeSwarm((1, 2, 3, 4))
    before = swarm.uavs[4].belief
    swarm.deliver(sender, 4, act, data)
    assert of(swarm, 4) == {why: 1}
    assert swarm.uavs[4].belief is before
    assert swarm.said


def test_a_repeated_message_is_a_replay() -> None:
    swarm = NodeSwarm((1, 2))
    data = SEAL.encode(frame(seen()))
    for _ in range(3):
        swarm.deliver(1, 2, "inform/observation", data)
    assert of(swarm, 2) == {RefusalReason.REPLAY: 2}
    assert swarm.uavs[2].belief.looks.sum() == 1


def test_a_message_from_before_a_restart_is_a_replay() -> None:
    swarm = NodeSwarm((1, 2))
    swarm.deliver(1, 2, "inform/state", SEAL.encode(frame(state(), incarnation=5)))
    swarm.deliver(1, 2, "inform/state", SEAL.encode(frame(state(), n=7, incarnation=4)))
    assert of(swarm, 2) == {RefusalReason.REPLAY: 1}


def test_replays_do_not_count_towards_the_senders_rate_limit() -> None:
    swarm = NodeSwarm((1, 2))
    data = SEAL.encode(frame(seen()))
    for _ in range(MOST + 10):
        swarm.deliver(1, 2, "inform/observation", data)
    swarm.deliver(1, 2, "inform/observation", SEAL.encode(frame(seen(2, (2, 2, False)), n=2)))
    assert swarm.uavs[2].belief.looks[2, 2] == 1


def test_a_flood_is_refused_and_later_messages_are_accepted() -> None:
    swarm = NodeSwarm((1, 2, 3))
    for n in range(MOST + 100):
        swarm.deliver(1, 2, "inform/state", SEAL.encode(frame(state(), n=n + 1, unix_s=UNIX_S + n * 1e-3)))
    assert of(swarm, 2) == {RefusalReason.TOO_FAST: 100}
    swarm.deliver(3, 2, "inform/observation", SEAL.encode(frame(seen(observer=3), sender=3)))
    assert swarm.uavs[2].belief.looks.sum() == 1  # a sender within its rate limit is still received


def test_the_rate_of_answers_is_limited() -> None:
    swarm = NodeSwarm((1, 2), NodeOptions(ROWS, COLS, sync_every_s=0.0))
    swarm.uavs[2].observe((0, 0, True))
    for n in range(100):
        swarm.deliver(1, 2, "query-ref/snapshot", SEAL.encode(frame(SnapshotAsked((), ()), n=n + 1)))
    served = swarm.uavs[2].node.counters.snapshots_served
    assert 1 <= served < 100
    assert of(swarm, 2) == {RefusalReason.TOO_FAST: 100 - served}


def test_a_second_content_of_one_observation_is_refused() -> None:
    swarm = NodeSwarm((1, 2))
    swarm.deliver(1, 2, "inform/observation", SEAL.encode(frame(seen(1, (0, 0, False)))))
    swarm.deliver(1, 2, "inform/observation", SEAL.encode(frame(seen(1, (0, 0, True)), n=2)))
    assert of(swarm, 2) == {RefusalReason.TWO_CONTENTS: 1}
    assert swarm.uavs[2].belief.hits.sum() == 0


def test_a_uav_that_sends_two_contents_is_flagged_by_both_receivers() -> None:
    swarm = NodeSwarm((1, 2, 3))
    for to, occupied in ((2, False), (3, True)):
        swarm.deliver(1, to, "inform/observation", SEAL.encode(frame(seen(1, (0, 0, occupied)))))
    swarm.carry = lambda sender, _to, _now_s: None if sender == 1 else 0.01
    swarm.run(30.0)
    for uav in (2, 3):
        assert swarm.uavs[uav].node.counters.flagged == {1: 1}
    assert any("[two-contents]" in line for line in swarm.said)


def test_a_checkpoint_of_other_observations_is_refused_and_its_observer_flagged() -> None:
    swarm = NodeSwarm((1, 2))
    observed = seen(1, (0, 0, False))
    swarm.deliver(1, 2, "inform/observation", SEAL.encode(frame(observed)))
    other = checkpoint(None, [seen(1, (0, 0, True))], COLS, ROWS * COLS)
    assert other is not None
    swarm.deliver(1, 2, "inform/relayed", SEAL.encode(frame(Relayed((SEAL.encode(frame(other)),)), n=2)))
    assert of(swarm, 2) == {RefusalReason.TWO_CONTENTS: 1}
    assert swarm.uavs[2].node.counters.flagged == {1: 1}
    assert swarm.uavs[2].belief.hits.sum() == 0


def test_a_second_process_of_the_same_vehicle_is_refused_and_reported() -> None:
    swarm = NodeSwarm((1, 2))
    frame_of_second_process = SEAL.encode(frame(seen(7, (0, 0, True)), n=50))
    swarm.deliver(
        2,
        1,
        "inform/relayed",
        SEAL.encode(frame(Relayed((frame_of_second_process,)), sender=2, incarnation=2)),
    )
    assert of(swarm, 1) == {RefusalReason.TWO_CONTENTS: 1}
    assert "vehicle 1" in swarm.said[0]
    assert "[two-contents]" in swarm.said[0]


def test_an_observation_that_contradicts_the_uavs_own_is_flagged_and_kept() -> None:
    swarm = NodeSwarm((1, 2))
    swarm.uavs[2].observe((3, 3, False), (3, 4, True))
    swarm.deliver(1, 2, "inform/observation", SEAL.encode(frame(seen(1, (3, 3, True), (3, 4, True)))))
    assert dict(swarm.uavs[2].node.counters.flagged) == {1: 1}
    assert all(part in swarm.said[0] for part in ("vehicle 1", "(3, 3)", "occupied"))
    assert swarm.uavs[2].belief.looks[3, 3] == 2
    output = swarm.uavs[2].node.publish(state(), swarm.now)
    content = SEAL.decode(output.messages[0].data).content
    assert isinstance(content, StateShared)
    assert content.flagged == (1,)  # the shared state reports the flag


@given(
    st.binary(max_size=400), st.integers(0, 300), st.sampled_from(("inform/state", "inform/snapshot", "x/y"))
)
def test_any_bytes_are_received_without_an_exception(data: bytes, sender: int, act: str) -> None:
    swarm = NodeSwarm((1, 2))
    swarm.deliver(sender, 2, act, data)
    swarm.deliver(sender, 2, act, bytes((VERSION, 0)) + data)
    assert sum(of(swarm, 2).values()) == 2


# --- signatures

KEYS = {uav: Ed25519PrivateKey.from_private_bytes(bytes([uav]) * 32) for uav in (1, 2, 3)}


def sign(sender: int, data: bytes) -> bytes:
    return KEYS[sender].sign(data)


def verify(sender: int, signature: bytes, data: bytes) -> bool:
    try:
        KEYS[sender].public_key().verify(signature, data)
    except (InvalidSignature, KeyError):
        return False
    return True


SIGNED = FrameCodec("test", sign, verify)


def forged(sender: int, content: Content, by: int) -> bytes:
    """Return a frame in the name of `sender` with the signature of `by`."""
    return FrameCodec("test", lambda _sender, data: sign(by, data)).encode(
        frame(content, sender=sender, n=500)
    )


FORGED: dict[str, tuple[str, bytes, RefusalReason]] = {
    "not signed": ("inform/observation", SEAL.encode(frame(seen())), RefusalReason.UNSIGNED),
    "signed by another": ("inform/observation", forged(1, seen(), by=3), RefusalReason.SIGNATURE),
    "of another swarm": (
        "inform/observation",
        FrameCodec("other", sign, verify).encode(frame(seen())),
        RefusalReason.SIGNATURE,
    ),
    "changed on its way": (
        "inform/observation",
        SIGNED.encode(frame(seen(1, (1, 1, False)))).replace(b"\x01\x01\xc2", b"\x01\x01\xc3"),
        RefusalReason.SIGNATURE,
    ),
    "an observation forged by its relay": (
        "inform/relayed",
        SIGNED.encode(frame(Relayed((forged(3, seen(observer=3), by=1),)))),
        RefusalReason.SIGNATURE,
    ),
}


@pytest.mark.parametrize(("act", "data", "why"), FORGED.values(), ids=FORGED)
def test_a_frame_without_the_uavs_key_is_refused(act: str, data: bytes, why: RefusalReason) -> None:
    swarm = NodeSwarm((1, 2, 3), seal=SIGNED)
    before = swarm.uavs[2].belief
    swarm.deliver(1, 2, act, data)
    assert of(swarm, 2) == {why: 1}
    assert swarm.uavs[2].belief is before


def test_relayed_frames_are_checked_by_their_observers_signature() -> None:
    swarm = NodeSwarm((1, 2, 3), NodeOptions(ROWS, COLS, relay=True), seal=SIGNED)
    swarm.carry = lambda sender, to, _now: None if {sender, to} == {1, 3} else 0.01
    swarm.run(5.0)
    swarm.uavs[1].observe((2, 2, True))
    swarm.run(1.0)
    assert swarm.agree()
    assert swarm.uavs[3].belief.hits[2, 2] == 1
    assert not any(uav.node.counters.refused for uav in swarm.uavs.values())


def test_a_forger_can_only_forge_its_own_observations() -> None:
    """A captured UAV has its own key only."""
    swarm = NodeSwarm((1, 2, 3), seal=SIGNED)
    swarm.uavs[2].observe((0, 0, False))
    swarm.run(2.0)
    lie = forged(1, seen(1, (0, 0, True), (5, 5, True)), by=1)
    swarm.deliver(1, 2, "inform/observation", lie)
    for content in (seen(1, observer=3), state(), SnapshotAsked((), ())):
        swarm.deliver(3, 2, frame(content).act, forged(3, content, by=1))
    belief = swarm.uavs[2].belief
    assert np.argwhere(belief.hits).tolist() == [[0, 0], [5, 5]]
    assert of(swarm, 2) == {RefusalReason.SIGNATURE: 3}
    assert dict(swarm.uavs[2].node.counters.flagged) == {1: 1}


# --- attacks by a captured UAV


def relayed(*frames: bytes, n: int, by: int = 1) -> bytes:
    return SEAL.encode(frame(Relayed(frames), sender=by, n=n))


def test_many_incarnations_of_a_forger_do_not_outvote_observations() -> None:
    swarm = NodeSwarm((1, 2, 3))
    swarm.uavs[3].observe((4, 4, True))
    swarm.run(0.5)
    most = [Observation(1, 1, 0.0, ((4, 4, True),), 0)]
    for i in range(300):
        made = checkpoint(None, most, COLS, ROWS * COLS)
        assert made is not None
        looks = zlib.compress(np.array([4 * COLS + 4, 65_535, 65_535], "<u4").tobytes())
        output = SEAL.encode(frame(Checkpoint(1, i + 1, 1, looks, 0), incarnation=i + 1))
        swarm.deliver(1, 2, "inform/relayed", SEAL.encode(frame(Relayed((output,)), n=i + 10, incarnation=1)))
    belief = swarm.uavs[2].belief
    assert belief.hits[4, 4] >= 1
    assert (belief.looks >= belief.hits).all()
    assert of(swarm, 2)[RefusalReason.TOO_FAST] == 300 - MAX_INCARNATIONS


def test_the_decoding_of_a_message_ends_after_many_invalid_frames() -> None:
    swarm = NodeSwarm((1, 2))
    swarm.deliver(1, 2, "inform/relayed", relayed(*[b"x"] * 256, n=10))
    assert of(swarm, 2) == {RefusalReason.MALFORMED: MAX_REFUSED_FRAMES}


def test_a_forged_observation_is_flagged_after_the_uavs_own() -> None:
    swarm = NodeSwarm((1, 2, 3))
    swarm.deliver(1, 2, "inform/observation", SEAL.encode(frame(seen(1, (3, 3, True)), n=50)))
    swarm.uavs[2].observe((3, 3, False), (3, 4, False))
    assert dict(swarm.uavs[2].node.counters.flagged) == {1: 1}
    assert all(part in swarm.said[0] for part in ("vehicle 1", "(3, 3)", "occupied"))


def test_a_request_fits_into_a_message_with_any_gaps() -> None:
    ids = tuple(range(1, 61))
    swarm = NodeSwarm(ids, NodeOptions(ROWS, COLS, k=3))
    for uav in ids[1:]:
        for incarnation in range(1, MAX_INCARNATIONS + 1):
            frames = [
                SEAL.encode(
                    frame(
                        seen(seq, observer=uav, incarnation=incarnation), sender=uav, incarnation=incarnation
                    )
                )
                for seq in (3, 5, 7, 9, 300, 1000)
            ]
            swarm.deliver(2, 1, "inform/relayed", relayed(*frames, n=uav * 10 + incarnation, by=2))
    node = swarm.uavs[1].node
    out = [
        o
        for t in range(60)
        for o in node.tick(Instant(10.0 + t, UNIX_S + t)).messages
        if o.act == "query-ref/snapshot"
    ]
    assert out
    assert max(len(o.data) for o in out) <= MAX_FRAME_BYTES


def test_requests_to_a_peer_with_false_claims_become_rarer() -> None:
    swarm = NodeSwarm((1, 2, 3), NodeOptions(ROWS, COLS, sync_every_s=1000.0))
    swarm.uavs[1].publish_state = lambda: None  # type: ignore[method-assign]
    for second in range(100):
        claim = replace(state(), last_seq=2**50, knows=second)
        claimed = frame(claim, n=100 + 2 * second, unix_s=swarm.unix_s)
        swarm.deliver(1, 2, "inform/state", SEAL.encode(claimed))
        answer = frame(Snapshot((), True), n=101 + 2 * second, unix_s=swarm.unix_s)
        swarm.deliver(1, 2, "inform/snapshot", SEAL.encode(answer))
        swarm.run(1.0)
    assert swarm.uavs[2].node.counters.sent["query-ref/snapshot"] <= 20


def test_an_old_relayed_state_is_ignored() -> None:
    swarm = NodeSwarm((1, 2, 3))
    old = SEAL.encode(frame(state(46.5), sender=3, n=1, unix_s=UNIX_S - 3600.0))
    swarm.deliver(1, 2, "inform/relayed", relayed(old, n=10))
    # The answer holds no state that is too old for its receiver.
    swarm.deliver(1, 2, "query-ref/snapshot", SEAL.encode(frame(SnapshotAsked((), ()), n=11)))
    answer = SEAL.decode(swarm.on_the_way[-1][-1]).content
    assert isinstance(answer, Snapshot)
    assert answer.frames == ()
