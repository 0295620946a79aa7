"""Listing and download of logs over MAVLink, on each autopilot."""

from typing import Any

import pytest
from files_client import MessageCodec
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.files import log_transfer
from sim_vehicle.files.log_transfer import LogRules, LogTransfer
from sim_vehicle.files.logs.recorder import StoredLog

BOTH = pytest.mark.parametrize("rules", [log_transfer.ARDUPILOT, log_transfer.PX4], ids=["ardupilot", "px4"])


class Vehicle:
    """A log transfer and its sent messages."""

    def __init__(self, rules: LogRules, *contents: bytes, **pace: float) -> None:
        self.logs = [
            StoredLog(i + 1, 100.0 * i, 100.0 * i + 50.5, bytearray(c)) for i, c in enumerate(contents)
        ]
        self.armed, self.now = False, 0.0
        self.sent: list[Any] = []
        self.texts: list[str] = []
        self.first_id = rules.first_id
        self.machine = LogTransfer(
            lambda: self.logs,
            erase=self.logs.clear,
            rules=rules,
            send=self.sent.append,
            send_text=lambda _severity, text: self.texts.append(text),
            armed=lambda: self.armed,
            **pace,
        )
        self.wire = MessageCodec()

    def receive(self, message: Any, wire: MessageCodec | None = None) -> list[Any]:
        self.machine.receive((wire or self.wire).to_vehicle(message), self.now)
        return self.take()

    def take(self) -> list[Any]:
        sent = [self.wire.to_station(message) for message in self.sent]
        self.sent.clear()
        return sent

    def wait(self, seconds: float) -> list[Any]:
        end, sent = self.now + seconds, self.take()
        while self.now < end - 1e-9:
            self.now += 0.1
            self.machine.tick(self.now)
            sent += self.take()
        return sent

    def listing(
        self, start: int = 0, end: int = 0xFFFF, wire: MessageCodec | None = None
    ) -> list[tuple[int, ...]]:
        sent = self.receive(mavlink.MAVLink_log_request_list_message(1, 1, start, end), wire)
        return [(m.id, m.num_logs, m.last_log_num, m.time_utc, m.size) for m in sent]

    def ask(self, log_id: int, offset: int, count: int, wire: MessageCodec | None = None) -> list[Any]:
        return self.receive(mavlink.MAVLink_log_request_data_message(1, 1, log_id, offset, count), wire)


def data(messages: list[Any]) -> bytes:
    return b"".join(bytes(m.data[: m.count]) for m in messages if m.get_type() == "LOG_DATA")


def test_ardupilot_counts_from_one_and_px4_from_zero() -> None:
    ardupilot = Vehicle(log_transfer.ARDUPILOT, b"a" * 10, b"b" * 20, b"c" * 30)
    assert ardupilot.listing() == [(1, 3, 3, 50, 10), (2, 3, 3, 150, 20), (3, 3, 3, 250, 30)]
    px4 = Vehicle(log_transfer.PX4, b"a" * 10, b"b" * 20, b"c" * 30)
    assert px4.listing() == [(0, 3, 2, 50, 10), (1, 3, 2, 150, 20), (2, 3, 2, 250, 30)]
    assert [entry[0] for entry in ardupilot.listing(2, 2)] == [2]
    assert [entry[0] for entry in px4.listing(1, 7)] == [1, 2]


@BOTH
@settings(max_examples=examples(60))
@given(
    content=st.binary(max_size=1500),
    asked=st.lists(
        st.tuples(st.integers(0, 1600), st.integers(0, 2**32 - 1) | st.integers(0, 400)), max_size=6
    ),
)
def test_a_download_returns_the_requested_part_of_the_log(
    rules: LogRules, content: bytes, asked: list[tuple[int, int]]
) -> None:
    vehicle = Vehicle(rules, b"another", content)
    vehicle.listing()
    for offset, count in asked:
        sent = vehicle.ask(rules.first_id + 1, offset, count)
        assert data(sent) == content[offset : offset + count]
        assert [m.ofs for m in sent] == [offset + 90 * i for i in range(len(sent))]
        assert all(m.count == 90 for m in sent[:-1])
        assert all(m.id == rules.first_id + 1 for m in sent)
        assert len(sent) == max(-(-len(content[offset : offset + count]) // 90), 1)


@BOTH
def test_a_download_is_paced(rules: LogRules) -> None:
    content = bytes(range(250)) * 400
    vehicle = Vehicle(rules, content, bytes_s=50_000, max_bytes_at_once=5_000)
    vehicle.listing()
    at_once = vehicle.ask(rules.first_id, 0, 2**32 - 1)
    assert 0 < len(at_once) * 109 <= 5_000
    assert vehicle.machine.busy
    in_a_second = vehicle.wait(1.0)
    assert 40_000 < len(in_a_second) * 109 < 52_000
    assert data(at_once + in_a_second + vehicle.wait(5.0)) == content
    assert not vehicle.machine.busy


@BOTH
def test_an_end_request_stops_a_download(rules: LogRules) -> None:
    vehicle = Vehicle(rules, bytes(50_000), bytes_s=10_000, max_bytes_at_once=1_000)
    vehicle.listing()
    vehicle.ask(rules.first_id, 0, 2**32 - 1)
    vehicle.receive(mavlink.MAVLink_log_request_end_message(1, 1))
    assert vehicle.wait(3.0) == []


def test_ardupilot_refuses_while_armed_with_one_text() -> None:
    vehicle = Vehicle(log_transfer.ARDUPILOT, bytes(50_000), bytes_s=10_000, max_bytes_at_once=1_000)
    vehicle.ask(1, 0, 2**32 - 1)
    vehicle.armed = True
    assert vehicle.wait(1.0) == []
    assert vehicle.listing() == vehicle.ask(1, 0, 90) == []
    vehicle.receive(mavlink.MAVLink_log_erase_message(1, 1))
    assert len(vehicle.logs) == 1
    assert vehicle.texts == ["Disarm for log download"]
    vehicle.armed = False
    assert data(vehicle.wait(10.0))


def test_px4_serves_logs_in_flight_after_a_list_request() -> None:
    vehicle = Vehicle(log_transfer.PX4, b"x" * 200)
    vehicle.armed = True
    assert vehicle.ask(0, 0, 200) == []
    vehicle.listing()
    assert data(vehicle.ask(0, 0, 200)) == b"x" * 200
    vehicle.receive(mavlink.MAVLink_log_request_end_message(1, 1))
    assert vehicle.ask(0, 0, 200) == []


def test_ardupilot_serves_one_station_at_a_time() -> None:
    vehicle = Vehicle(log_transfer.ARDUPILOT, b"y" * 20_000, bytes_s=10_000, max_bytes_at_once=1_000)
    other = MessageCodec(sysid=254)
    first = vehicle.ask(1, 0, 2**32 - 1)
    assert vehicle.ask(1, 90, 90) == []
    assert vehicle.texts == []
    assert vehicle.ask(1, 0, 90, other) == []
    assert vehicle.texts == ["Log download in progress"]
    assert data(first + vehicle.wait(5.0)) == b"y" * 20_000
    assert data(vehicle.ask(1, 0, 90, other)) == b"y" * 90


def test_px4_serves_stations_in_turns() -> None:
    vehicle = Vehicle(log_transfer.PX4, b"a" * 9_000, b"b" * 9_000, bytes_s=10_000, max_bytes_at_once=1_000)
    other = MessageCodec(sysid=254)
    sent: list[Any] = []
    vehicle.listing()
    vehicle.listing(wire=other)
    sent += vehicle.ask(0, 0, 2**32 - 1)
    sent += vehicle.ask(1, 0, 2**32 - 1, other)
    sent += vehicle.wait(1.0)
    counts = [sum(m.id == log_id for m in sent) for log_id in (0, 1)]
    assert abs(counts[0] - counts[1]) < 20
    sent += vehicle.wait(5.0)
    assert data([m for m in sent if m.get_type() == "LOG_DATA" and m.id == 1]) == b"b" * 9_000


STEPS = st.one_of(
    st.tuples(st.just("list"), st.integers(0, 65535), st.integers(0, 65535), st.integers(1, 12)),
    st.tuples(st.just("data"), st.integers(0, 5), st.integers(0, 2**32 - 1), st.integers(1, 12)),
    st.tuples(st.sampled_from(["erase", "end", "arm", "drop", "wait", "reset"])),
)


@BOTH
@settings(max_examples=examples(80))
@given(steps=st.lists(STEPS, max_size=25))
def test_any_requests_leave_the_vehicle_working(rules: LogRules, steps: list[Any]) -> None:
    vehicle = Vehicle(rules, bytes(3_000), bytes(100), b"", bytes_s=5_000, max_bytes_at_once=500)
    for kind, *values in steps:
        if kind == "list":
            vehicle.listing(values[0], values[1], MessageCodec(sysid=values[2]))
        elif kind == "data":
            vehicle.ask(values[0], values[1], values[1], MessageCodec(sysid=values[2]))
        elif kind == "erase":
            vehicle.receive(mavlink.MAVLink_log_erase_message(1, 1))
        elif kind == "end":
            vehicle.receive(mavlink.MAVLink_log_request_end_message(1, 1))
        elif kind == "arm":
            vehicle.armed = not vehicle.armed
        elif kind == "drop":
            del vehicle.logs[:1]
        elif kind == "reset":
            vehicle.machine.reset()
        else:
            vehicle.wait(0.3)
    vehicle.armed = False
    vehicle.wait(10.0)
    assert not vehicle.machine.busy
