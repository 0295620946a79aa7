"""The bytes on the bus: fixed, tolerant of later fields, and typed by the acts of FIPA."""

from __future__ import annotations

import math
import re
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.core import frames
from swarmctl.core.frames import (
    VERSION,
    Content,
    Frame,
    FrameCodec,
    HeldObservations,
    IntentPoint,
    IntentShared,
    MemberShared,
    MessageRefused,
    RefusalReason,
    Relayed,
    Snapshot,
    SnapshotAsked,
    StateShared,
)
from swarmctl.core.observation import Checkpoint, Observation

SEAL = FrameCodec("test")
AT = (46.0, 14.5)
SEEN = Observation(3, 7, 12.5, ((4, 7, True), (4, 8, False)), 2)
STATE = StateShared(12.5, 46.0, 14.5, 40.0, 340.0, "flying", 9, 1, last_seq=7, knows=2**40, mode="AUTO")
INTENT = IntentShared(
    4, (IntentPoint(0.0, 46.0, 14.5, 340.0), IntentPoint(21.5, 46.001, 14.5, 340.0)), may_change=False
)
MEMBER = MemberShared(
    46.0,
    14.5,
    340.0,
    (3.0, 4.0, 0.0),
    error_m=0.5,
    along_m=120.0,
    speed_m_s=5.0,
    route_id=2,
    route=((46.0, 14.5), (46.001, 14.5)),
    shapes=((60.0, 1),),
    height_amsl_m=340.0,
)
ASKED = SnapshotAsked((HeldObservations(1, 5, 64, 70, (72, 73), 11),), ((1, 1.5),))

# Bytes of version 3: a change of one of them breaks every swarm with another build.
GOLDEN: tuple[tuple[Content, str], ...] = (
    (
        SEEN,
        (
            "030087a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000a7"
            "636f6e74656e7486a474797065b2696e666f726d2f6f62736572766174696f6ea86f6273657276657203a373"
            "657107a674696d655f73cb4029000000000000a563656c6c7392930407c3930408c2ab696e6361726e617469"
            "6f6e02a76c61745f646567cb4047000000000000a76c6f6e5f646567cb402d000000000000"
        ),
    ),
    (
        STATE,
        (
            "030085a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000a7"
            "636f6e74656e74de000ca474797065ac696e666f726d2f7374617465a674696d655f73cb4029000000000000"
            "a76c61745f646567cb4047000000000000a76c6f6e5f646567cb402d000000000000a9616c745f72656c5f6d"
            "cb4044000000000000aa616c745f616d736c5f6dcb4075400000000000a57068617365a6666c79696e67aa6e"
            "5f6f6273657276656409a76e5f666f756e6401a86c6173745f73657107a56b6e6f7773cf0000010000000000"
            "a46d6f6465a44155544f"
        ),
    ),
    (
        INTENT,
        (
            "030087a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000a7"
            "636f6e74656e7484a474797065ad696e666f726d2f696e74656e74a7706c616e5f696404a6706f696e747392"
            "94cb0000000000000000cb4047000000000000cb402d000000000000cb407540000000000094cb4035800000"
            "000000cb40470020c49ba5e3cb402d000000000000cb4075400000000000aa6d61795f6368616e6765c2a76c"
            "61745f646567cb4047000000000000a76c6f6e5f646567cb402d000000000000"
        ),
    ),
    (
        MEMBER,
        (
            "030085a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000a7"
            "636f6e74656e74de000ca474797065ad696e666f726d2f6d656d626572a76c61745f646567cb4047000000000000"
            "a76c6f6e5f646567cb402d000000000000aa616c745f616d736c5f6dcb4075400000000000ac76656c6f6369"
            "74795f6d5f7393cb4008000000000000cb4010000000000000cb0000000000000000a76572726f725f6dcb3f"
            "e0000000000000a7616c6f6e675f6dcb405e000000000000a973706565645f6d5f73cb4014000000000000a8"
            "726f7574655f696402a5726f7574659292cb4047000000000000cb402d00000000000092cb40470020c49ba5"
            "e3cb402d000000000000a67368617065739192cb404e00000000000001ad6865696768745f616d736c5f6dcb"
            "4075400000000000"
        ),
    ),
    (
        ASKED,
        (
            "030087a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000"
            "a7636f6e74656e7483a474797065b271756572792d7265662f736e617073686f74a4686176659196010540"
            "469248490ba6737461746573919201cb3ff8000000000000a76c61745f646567cb4047000000000000a76c"
            "6f6e5f646567cb402d000000000000"
        ),
    ),
    (
        Checkpoint(3, 2, 64, b"zlib", 7),
        (
            "030087a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000"
            "a7636f6e74656e7486a474797065b1696e666f726d2f636865636b706f696e74a86f6273657276657203ab"
            "696e6361726e6174696f6e02a47570746f40a67061636b6564c4047a6c6962a46d61726b07a76c61745f64"
            "6567cb4047000000000000a76c6f6e5f646567cb402d000000000000"
        ),
    ),
    (
        Snapshot((b"a frame",), True),
        (
            "030087a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000a7"
            "636f6e74656e7483a474797065af696e666f726d2f736e617073686f74a66672616d657391c4076120667261"
            "6d65a46c617374c3a76c61745f646567cb4047000000000000a76c6f6e5f646567cb402d000000000000"
        ),
    ),
    (
        Relayed((b"a frame",)),
        (
            "030087a673656e64657203ab696e6361726e6174696f6e02a16e09a6756e69785f73cb41dad27480100000a7"
            "636f6e74656e7482a474797065ae696e666f726d2f72656c61796564a66672616d657391c40761206672616d"
            "65a76c61745f646567cb4047000000000000a76c6f6e5f646567cb402d000000000000"
        ),
    ),
)


def encoded(content: Content) -> bytes:
    lat_deg, lon_deg = (None, None) if isinstance(content, StateShared | MemberShared) else AT
    return SEAL.encode(Frame(3, 2, 9, 1_800_000_000.25, content, lat_deg, lon_deg))


def row_name(row: tuple[Content, str]) -> str:
    return frames.act_of(row[0])


@pytest.mark.parametrize("row", GOLDEN, ids=row_name)
def test_the_bytes_are_those_that_other_builds_write_and_read(row: tuple[Content, str]) -> None:
    content, written = row
    assert encoded(content).hex() == written
    assert SEAL.decode(bytes.fromhex(written)).content == content


def test_every_kind_of_content_has_golden_bytes_and_stands_in_the_table() -> None:
    kinds = {frames.act_of(content) for content, _ in GOLDEN}
    assert kinds == set(re.findall(r"^\| `([a-z-]+/[a-z]+)` \|", frames.__doc__ or "", re.MULTILINE))
    assert {type(content) for content, _ in GOLDEN} == set(Content.__args__)


def test_the_page_on_the_network_lists_every_act() -> None:
    page = (Path(__file__).parents[2] / "docs" / "network.md").read_text(encoding="utf-8")
    for content, _ in GOLDEN:
        assert f"`{frames.act_of(content)}`" in page


@pytest.mark.parametrize("row", GOLDEN, ids=row_name)
def test_fields_that_a_later_version_adds_are_tolerated(row: tuple[Content, str]) -> None:
    content, written = row
    body = msgspec.msgpack.decode(bytes.fromhex(written)[2:])
    body["later"] = {"new": [1, 2]}
    body["content"]["later"] = "new"
    assert SEAL.decode(bytes((VERSION, 0)) + msgspec.msgpack.encode(body)).content == content


def refusal(content: Content, /, *, of_frame: bool = False, **changes: object) -> MessageRefused:
    """Return the refusal of a content, or of its frame, with changed fields; None leaves a field out."""
    body = msgspec.msgpack.decode(encoded(content)[2:])
    part = body if of_frame else body["content"]
    part.update(changes)
    body = {name: value for name, value in body.items() if value is not None}
    with pytest.raises(MessageRefused) as refused:
        SEAL.decode(bytes((VERSION, 0)) + msgspec.msgpack.encode(body))
    return refused.value


@pytest.mark.parametrize("field", ["sender", "incarnation", "n", "unix_s", "content"])
def test_a_missing_field_is_refused_by_name(field: str) -> None:
    refused = refusal(SEEN, of_frame=True, **{field: None})
    assert field in str(refused)
    assert refused.why is RefusalReason.MALFORMED


@pytest.mark.parametrize(
    ("field", "value"),
    [("sender", 0), ("sender", 255), ("n", 0), ("n", 1.5), ("unix_s", math.nan), ("lat_deg", math.inf)],
)
def test_an_invalid_value_is_refused(field: str, value: float) -> None:
    refusal(SEEN, of_frame=True, **{field: value})


@pytest.mark.parametrize(
    ("content", "field", "value"),
    [
        (STATE, "alt_amsl_m", math.nan),
        (STATE, "earliest_in_s", math.nan),
        # Sums of numbers out of any autopilot's range may overflow.
        (STATE, "alt_rel_m", 1e12),
        (STATE, "alt_amsl_m", -1e12),
        (STATE, "velocity_m_s", [1.7e308, 0.0, 0.0]),
        (INTENT, "around_m", [1e200, 0.0]),
        (INTENT, "around_m", [0.0, 1e200]),
        (INTENT, "points", [[0.0, 46.0, 14.5, 1e200]]),
        (INTENT, "points", [[0.0, 46.0, 14.5, 340.0], [0.0, 46.0, 14.5, 340.0]]),
        (INTENT, "points", [[-1.0, 46.0, 14.5, 340.0]]),
        (INTENT, "points", [[frames.MAX_AHEAD_S + 1.0, 46.0, 14.5, 340.0]]),
        (INTENT, "points", [[0.0, 91.0, 14.5, 340.0]]),
        (INTENT, "points", [[0.0, 46.0, 14.5, math.nan]]),
        (INTENT, "points", [[math.inf, 46.0, 14.5, 340.0]]),
        (INTENT, "points", [[0.0, 46.0, 14.5]]),
        (INTENT, "points", [[float(t), 46.0, 14.5, 340.0] for t in range(frames.MAX_POINTS + 1)]),
        (MEMBER, "error_m", -1.0),
        (MEMBER, "error_m", math.nan),
        (MEMBER, "age_s", -1.0),
        (MEMBER, "along_m", math.inf),
        (MEMBER, "route", [[91.0, 0.0]]),
    ],
)
def test_an_impossible_message_is_refused(content: Content, field: str, value: object) -> None:
    assert refusal(content, **{field: value}).why is RefusalReason.MALFORMED


def test_the_longest_intent_fits_into_a_relayed_message() -> None:
    points = tuple(IntentPoint(t + 0.1, 46.0 + 1e-7 * t, 14.1, 340.1) for t in range(frames.MAX_POINTS))
    assert len(encoded(IntentShared(2**31, points))) < frames.MAX_INNER_BYTES / 3


@given(st.binary(max_size=300))
def test_random_bytes_raise_no_other_exception(data: bytes) -> None:
    for candidate in (data, bytes((VERSION, 0)) + data, bytes((VERSION, 1)) + data):
        try:
            SEAL.decode(candidate)
        except MessageRefused:
            continue


@given(st.data())
def test_corrupted_bytes_raise_no_other_exception(data: st.DataObject) -> None:
    good = bytearray(encoded(data.draw(st.sampled_from([content for content, _ in GOLDEN]))))
    good[data.draw(st.integers(0, len(good) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        frame = SEAL.decode(bytes(good))
    except MessageRefused:
        return
    assert isinstance(frame, Frame)
