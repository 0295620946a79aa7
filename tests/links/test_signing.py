"""MAVLink 2 signing, checked against pymavlink in both directions."""

from __future__ import annotations

import base64
import hashlib
import json
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from swarmctl.links.signing import (
    AHEAD,
    LAST_TIMESTAMP,
    LATE,
    OTHER_KEY,
    RENEW_TICKS,
    REPEATED,
    RESERVE_TICKS,
    TICKS_PER_S,
    UNSIGNED,
    Signing,
    ticks,
)
from swarmctl.mavlink.protocol.codec import Encoder, Frame
from swarmctl.security.files import KeyringError
from swarmctl.security.mavlink_key import TimestampFile, read_mavlink_key

KEY = bytes(range(32))
START = ticks(1_767_225_600_000_000)
"""The beginning of 2026."""


class MemoryStore:
    """A timestamp store in memory."""

    def __init__(self) -> None:
        self.kept = 0
        self.full = False

    def load(self) -> int:
        return self.kept

    def save(self, timestamp: int) -> None:
        if self.full:
            raise OSError(28, "No space left on device")
        self.kept = max(self.kept, timestamp)


def peer(key: bytes = KEY, *, timestamp: int = START, link_id: int = 0, sysid: int = 1) -> mavlink.MAVLink:
    """Return a pymavlink codec that signs and requires signatures."""
    codec = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1)
    codec.robust_parsing = True
    codec.signing.secret_key, codec.signing.sign_outgoing = key, True
    codec.signing.timestamp, codec.signing.link_id = timestamp, link_id
    return codec


def sent_by(codec: mavlink.MAVLink, message: Any = None) -> bytes:
    message = message or mavlink.MAVLink_system_time_message(1, 2)
    data = bytes(message.pack(codec))
    codec.seq = (codec.seq + 1) % 256
    return data


def signing(**more: Any) -> Signing:
    return Signing(KEY, MemoryStore(), **more)


def accepts(ours: Signing, data: bytes, clock: int) -> bool:
    frame = Frame(data, data[5], data[6], int.from_bytes(data[7:10], "little"))
    return not ours.why_not(frame, clock)


def test_the_timestamp_counts_10_microseconds_since_2015() -> None:
    assert ticks(1_420_070_400_000_000) == 0
    assert ticks(1_420_070_401_000_019) == TICKS_PER_S + 1
    assert ticks(0) == 0


@settings(derandomize=True, deadline=None, max_examples=examples(100))
@given(count=st.integers(1, 30), line=st.integers(0, 3), step=st.integers(0, 5))
def test_pymavlink_accepts_the_signatures(count: int, line: int, step: int) -> None:
    ours, theirs, encoder = signing(first_link_id=7), peer(), Encoder()
    for i in range(count):
        message = mavlink.MAVLink_statustext_message(6, b"%d" % i)
        frame = encoder.pack(message, "one", ours.sign(line, START + i * step))
        (received,) = theirs.parse_buffer(frame)
        assert received.get_type() == "STATUSTEXT"
        assert received.get_signed()
        assert received.get_link_id() == 7 + line
    assert theirs.signing.goodsig_count == count


def test_an_encoder_without_a_signature_signs_nothing() -> None:
    encoder, ours = Encoder(), signing()
    message = mavlink.MAVLink_system_time_message(1, 2)
    signed = encoder.pack(message, "one", ours.sign(0, START))
    assert len(signed) - len(encoder.pack(message, "one")) == 13


def test_a_frame_signed_by_pymavlink_is_accepted_once() -> None:
    ours, theirs = signing(), peer()
    frames = [sent_by(theirs) for _ in range(5)]
    assert all(accepts(ours, frame, START) for frame in frames)
    assert not any(accepts(ours, frame, START) for frame in frames)
    assert ours.refused == {REPEATED: 5}


def test_unsigned_frames_are_refused_except_those_of_a_radio() -> None:
    ours = signing()
    plain = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    old = bytes(mavlink.MAVLink_system_time_message(1, 2).pack(plain, force_mavlink1=True))
    assert not accepts(ours, sent_by(plain), START)
    assert not accepts(ours, old, START)
    assert accepts(ours, sent_by(plain, mavlink.MAVLink_radio_status_message(1, 1, 1, 1, 1, 1, 1)), START)
    assert ours.refused == {UNSIGNED: 2}


def test_another_key_and_a_changed_byte_are_refused() -> None:
    ours = signing()
    good = sent_by(peer())
    assert not accepts(ours, sent_by(peer(bytes(31) + b"x")), START)
    for i in (4, 12, len(good) - 14, len(good) - 7, len(good) - 1):
        assert not accepts(ours, good[:i] + bytes([good[i] ^ 1]) + good[i + 1 :], START)
    assert ours.refused[OTHER_KEY] == 6
    assert accepts(ours, good, START)


def test_a_new_stream_may_be_at_most_a_minute_behind() -> None:
    ours = signing()
    assert accepts(ours, sent_by(peer(timestamp=START - 60 * TICKS_PER_S)), START)
    assert not accepts(ours, sent_by(peer(timestamp=START - 60 * TICKS_PER_S - 1, sysid=2)), START)
    assert ours.refused == {LATE: 1}


def test_each_link_component_and_system_has_its_own_timestamp() -> None:
    ours = signing()
    assert accepts(ours, sent_by(peer(timestamp=START + 10)), START)
    assert accepts(ours, sent_by(peer(timestamp=START + 5, link_id=1)), START)
    assert accepts(ours, sent_by(peer(timestamp=START + 5, sysid=2)), START)
    assert not accepts(ours, sent_by(peer(timestamp=START + 5)), START)


DAY = 24 * 3600 * TICKS_PER_S


def test_a_timestamp_more_than_a_day_ahead_is_refused_and_does_not_move_the_own_time() -> None:
    store = MemoryStore()
    ours = Signing(KEY, store)
    assert accepts(ours, sent_by(peer(timestamp=START + DAY)), START)
    assert not accepts(ours, sent_by(peer(timestamp=START + DAY + 1, sysid=2)), START)
    assert not accepts(ours, sent_by(peer(timestamp=LAST_TIMESTAMP, sysid=3)), START)
    assert ours.refused == {AHEAD: 2}
    stamps = [ours.sign(0, START).timestamp for _ in range(3)]
    assert stamps == [START + DAY + 1, START + DAY + 2, START + DAY + 3]
    assert Signing(KEY, store).sign(0, START).timestamp < START + DAY + 2 * RESERVE_TICKS


def test_a_vehicle_with_a_later_timestamp_is_accepted_after_the_clock_went_back_by_a_year() -> None:
    store = MemoryStore()
    stamp = Signing(KEY, store).sign(0, START).timestamp
    after = Signing(KEY, store)
    assert accepts(after, sent_by(peer(timestamp=stamp)), START - 365 * DAY)
    assert after.sign(0, START - 365 * DAY).timestamp > stamp


def test_a_key_without_remaining_timestamps_is_refused_at_the_start() -> None:
    store = MemoryStore()
    store.kept = LAST_TIMESTAMP
    with pytest.raises(ValueError, match=r"\[timestamps-used-up\]"):
        Signing(KEY, store)


@settings(derandomize=True, deadline=None, max_examples=examples(200))
@given(
    runs=st.lists(
        st.tuples(st.integers(-100 * TICKS_PER_S, 100 * TICKS_PER_S), st.integers(1, 40), st.integers(0, 9)),
        max_size=6,
    )
)
def test_no_timestamp_is_used_twice_after_crashes_and_backward_clock_jumps(
    runs: list[tuple[int, int, int]],
) -> None:
    store, last, clock = MemoryStore(), -1, START
    for jump, count, step_s in runs:
        clock += jump
        ours = Signing(KEY, store)
        for _ in range(count):
            clock += step_s * TICKS_PER_S
            stamp = ours.sign(0, clock).timestamp
            assert stamp > last
            last = stamp


def test_the_store_is_written_ahead_and_rarely() -> None:
    store = MemoryStore()
    ours = Signing(KEY, store)
    ours.sign(0, START)
    assert store.kept == START + RESERVE_TICKS
    ours.sign(0, START + RESERVE_TICKS - RENEW_TICKS - 1)
    assert store.kept == START + RESERVE_TICKS
    ours.sign(0, START + RESERVE_TICKS - RENEW_TICKS)
    assert store.kept == START + 2 * RESERVE_TICKS - RENEW_TICKS


class Disk:
    """A pool that delays its writes until `turn`, if `answers_at_once` is false."""

    def __init__(self) -> None:
        self.answers_at_once = True
        self.waited_s: list[float] = []
        self._asked: list[tuple[WriteFuture, Any, int]] = []

    def submit(self, keep: Any, timestamp: int) -> WriteFuture:
        self._asked.append((WriteFuture(self.waited_s), keep, timestamp))
        future = self._asked[-1][0]
        if self.answers_at_once:
            self.turn()
        return future

    def turn(self) -> None:
        while self._asked:
            future, keep, timestamp = self._asked.pop(0)
            future.set_result(keep(timestamp))


class WriteFuture(Future[None]):
    """The future of a write; `exception` records the requested wait and returns at once."""

    def __init__(self, waited_s: list[float]) -> None:
        super().__init__()
        self._waited_s = waited_s

    def exception(self, timeout: float | None = None) -> BaseException | None:
        if not self.done() and timeout:
            self._waited_s.append(timeout)
        return super().exception(0.0)


def test_a_slow_disk_causes_no_delay_and_no_timestamp_above_the_stored_one() -> None:
    store, disk = MemoryStore(), Disk()
    ours = Signing(KEY, store, pool=disk)
    ours.sign(0, START)
    disk.answers_at_once = False
    for second in range(600):
        stamp = ours.sign(0, START + second * TICKS_PER_S).timestamp
        assert stamp < store.kept
        if second % 25 == 0:
            disk.turn()
    assert disk.waited_s == []
    assert ours.trouble == ""


def test_a_clock_jump_waits_for_the_store_even_during_a_write() -> None:
    store, disk = MemoryStore(), Disk()
    ours = Signing(KEY, store, pool=disk)
    ours.sign(0, START)
    disk.answers_at_once = False
    ours.sign(0, START + RESERVE_TICKS - 1)
    disk.turn()
    disk.answers_at_once = True
    assert ours.sign(0, START + 10 * RESERVE_TICKS).timestamp < store.kept


def test_a_disk_without_an_answer_is_reported_and_awaited_once() -> None:
    store, disk = MemoryStore(), Disk()
    disk.answers_at_once = False
    ours = Signing(KEY, store, pool=disk)
    for second in range(100):
        assert ours.sign(0, START + second * TICKS_PER_S).timestamp == START + second * TICKS_PER_S
    assert len(disk.waited_s) == 1
    assert ours.trouble.endswith("[timestamps-not-stored]")
    disk.answers_at_once = True
    disk.turn()
    assert ours.sign(0, START + 200 * TICKS_PER_S).timestamp < store.kept


def test_a_timestamp_file_written_by_a_thread_stays_ahead(tmp_path: Path) -> None:
    file = TimestampFile(tmp_path / "key")
    with ThreadPoolExecutor(1) as pool:
        ours = Signing(KEY, file, pool=pool)
        for second in range(0, 300, 7):
            stamp = ours.sign(0, START + second * TICKS_PER_S).timestamp
            if second % 3 == 0:
                # A jump, as after a timestamp from a station with its clock ahead.
                stamp = ours.sign(0, stamp + 2 * RESERVE_TICKS).timestamp
            assert stamp < file.load()
    assert ours.trouble == ""


def test_a_store_that_cannot_be_written_is_an_error_at_the_start_and_a_message_in_flight() -> None:
    store = MemoryStore()
    ours = Signing(KEY, store)
    store.full = True
    assert ours.sign(0, START).timestamp == START
    assert "No space left on device" in ours.trouble
    assert ours.trouble.endswith("[timestamps-not-stored]")
    with pytest.raises(OSError, match="No space"):
        Signing(KEY, store)


def test_the_timestamp_file_never_goes_back_and_invalid_content_is_reported(tmp_path: Path) -> None:
    one, other = TimestampFile(tmp_path / "key"), TimestampFile(tmp_path / "key")
    assert one.load() == 0
    one.save(START)
    other.save(START - 5)
    assert (one.load(), other.load()) == (START, START)
    assert one.path.stat().st_mode & 0o077 == 0
    one.path.write_text("yesterday")
    with pytest.raises(ValueError, match="'yesterday'"):
        one.load()


def key_file(folder: Path, text: str, mode: int = 0o600) -> Path:
    file = folder / "signing.key"
    file.write_text(text)
    file.chmod(mode)
    return file


@pytest.mark.parametrize(
    "text",
    [
        hashlib.sha256(b"correct horse").hexdigest() + "\n",
        hashlib.sha256(b"correct horse").hexdigest().upper(),
        base64.b64encode(hashlib.sha256(b"correct horse").digest()).decode() + "\n",
        "passphrase: correct horse\n",
    ],
)
def test_a_key_is_read_in_each_of_its_forms(tmp_path: Path, text: str) -> None:
    assert read_mavlink_key(key_file(tmp_path, text)) == hashlib.sha256(b"correct horse").digest()


@pytest.mark.parametrize("text", ["", "correct horse", "00" * 31, "passphrase:", json.dumps([1])])
def test_an_invalid_key_is_refused_with_the_expected_form(tmp_path: Path, text: str) -> None:
    with pytest.raises(KeyringError, match="64 hexadecimal digits"):
        read_mavlink_key(key_file(tmp_path, text))


def test_a_world_readable_key_and_a_key_of_zeros_are_refused(tmp_path: Path) -> None:
    with pytest.raises(KeyringError, match="0640"):
        read_mavlink_key(key_file(tmp_path, "11" * 32, 0o640))
    with pytest.raises(KeyringError, match="zero"):
        read_mavlink_key(key_file(tmp_path, "00" * 32))
    with pytest.raises(KeyringError, match="No such file"):
        read_mavlink_key(tmp_path / "nowhere")
