"""Frames found in any bytes that arrive over a link."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.mavlink.protocol.codec import Encoder, Frame, FrameSplitter, decode, payload

MODEST = settings(max_examples=examples(100), deadline=None, derandomize=True)
TEXT = st.binary(max_size=80).map(lambda b: b.replace(b"\xfd", b"I").replace(b"\xfe", b"n"))


def heartbeat(seq: int = 0, sysid: int = 7, v1: bool = False) -> bytes:
    mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
    mav.seq = seq
    return mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3).pack(mav, force_mavlink1=v1)


def unknown_frame(sysid: int = 9, msgid: int = 54_321, payload: bytes = b"\x01\x02\x03") -> bytes:
    head = bytes((0xFD, len(payload), 0, 0, 5, sysid, 1, msgid & 255, msgid >> 8 & 255, msgid >> 16))
    return head + payload + b"\xab\xcd"


def split(data: bytes) -> list[Frame]:
    return FrameSplitter().feed(data)


def test_mavlink_1_frames_are_read_too():
    (frame,) = split(heartbeat(v1=True, sysid=3))
    assert (frame.sysid, frame.compid, frame.msgid) == (3, 1, 0)
    assert decode(frame).custom_mode == 4


def test_signed_frames_are_read_with_their_signature():
    mav = mavlink.MAVLink(None, srcSystem=4, srcComponent=1)
    mav.signing.secret_key = b"k" * 32
    mav.signing.sign_outgoing = True
    data = mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3).pack(mav)
    frames = split(data + heartbeat())
    assert [f.sysid for f in frames] == [4, 7]
    assert frames[0].data == data
    assert decode(frames[0]).type == 2


def test_a_valid_frame_of_an_unknown_message_keeps_its_system_id_and_is_never_decoded():
    splitter = FrameSplitter()
    frames = splitter.feed(heartbeat() + unknown_frame(sysid=9) + heartbeat(1))
    assert [f.sysid for f in frames] == [7, 9, 7]
    assert not frames[1].known
    assert decode(frames[1]) is None


def test_a_frame_with_unknown_flags_is_skipped():
    mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    data = bytearray(mavlink.MAVLink_heartbeat_message(2, 3, 81, 4, 3, 3).pack(mav))
    data[2] = 0x02
    crc = mavlink.x25crc(bytes(data[1:-2]) + bytes((50,))).crc  # 50: CRC_EXTRA of HEARTBEAT
    data[-2:] = crc.to_bytes(2, "little")
    assert [f.data[4] for f in split(bytes(data) + heartbeat(3))] == [3]


def test_a_wrong_checksum_loses_only_its_frame():
    splitter = FrameSplitter()
    broken = bytearray(heartbeat(0))
    broken[12] ^= 0x40
    frames = splitter.feed(bytes(broken) + heartbeat(1))
    assert [f.data[4] for f in frames] == [1]


def test_a_frame_directly_behind_a_stray_start_byte_is_found():
    frames = split(b"\xfd" + heartbeat(4) + b"." * 300)
    assert [f.data[4] for f in frames] == [4]


def test_a_frame_is_found_within_the_remains_of_a_truncated_one():
    big = mavlink.MAVLink_statustext_message(4, b"x" * 50).pack(mavlink.MAVLink(None, 7, 1))
    frames = split(big[:25] + b"".join(heartbeat(i) for i in range(6)))
    assert [f.data[4] for f in frames] == [0, 1, 2, 3, 4, 5]


@MODEST
@given(
    texts=st.lists(TEXT, min_size=1, max_size=8),
    cuts=st.lists(st.integers(0, 600), max_size=12),
)
def test_every_frame_between_texts_arrives_from_any_division_of_the_stream(texts, cuts):
    stream = b"".join(text + heartbeat(i) for i, text in enumerate(texts))
    edges = sorted({0, len(stream), *(c for c in cuts if c < len(stream))})
    splitter = FrameSplitter()
    frames = [f for a, b in pairwise(edges) for f in splitter.feed(stream[a:b])]
    assert [f.data[4] for f in frames] == list(range(len(texts)))


@MODEST
@given(garbage=st.lists(st.binary(max_size=300), max_size=6))
def test_frames_after_any_invalid_bytes_are_found(garbage):
    splitter = FrameSplitter()
    for piece in garbage:
        for frame in splitter.feed(piece):
            decode(frame)
    splitter.feed(b"." * 300)  # longer than any frame that garbage can have promised
    assert [f.data for f in splitter.feed(heartbeat(9))] == [heartbeat(9)]


def test_each_address_gets_an_unbroken_sequence():
    encoder = Encoder()
    message = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    numbers = [(c, encoder.pack(message, c)[4]) for c in ("a", "b", "a", "a", "b")]
    assert numbers == [("a", 0), ("b", 0), ("a", 1), ("a", 2), ("b", 1)]
    assert [encoder.pack(message, "a")[4] for _ in range(254)][-2:] == [255, 0]


def test_a_ground_station_sends_mavlink_2_as_255_190():
    data = Encoder().pack(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), "a")
    assert (data[0], data[5], data[6]) == (0xFD, 255, 190)


@pytest.mark.parametrize("cut", [0, 3])
@pytest.mark.parametrize("msgid", sorted(mavlink.mavlink_map))
def test_a_message_is_decoded_as_pymavlink_decodes_it(msgid: int, cut: int):
    kind = mavlink.mavlink_map[msgid]
    content = random.Random(msgid).randbytes(max(kind.unpacker.size - cut, 1))
    body = bytes((len(content), 0, 0, 5, 7, 1)) + msgid.to_bytes(3, "little") + content
    crc = mavlink.x25crc(body + bytes((kind.crc_extra,))).crc
    (frame,) = split(b"\xfd" + body + crc.to_bytes(2, "little"))
    ours, theirs = decode(frame), mavlink.MAVLink(None).decode(bytearray(frame.data))
    assert repr(ours.to_dict()) == repr(theirs.to_dict())
    assert (ours.get_srcSystem(), ours.get_srcComponent()) == (7, 1)
    assert payload(ours) == content
