"""Flight logs: the list, the download, erasing."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import at_most, equal, holds
from sim_vehicle.conformance.guard import ALTER
from sim_vehicle.conformance.outcomes import CheckFailed, Skip
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.traffic import Condition
from sim_vehicle.conformance.vehicle import VehicleUnderTest

CHUNK = 90  # bytes of data in a full LOG_DATA
REQUESTS = 8  # a request asks for the part from the first lost message on
LIST_S = 4.0  # longest wait for the first LOG_ENTRY after a request
PART_BYTES = 900  # size of the part of a log that is read twice
ERASE_S = 30.0  # longest time for erasing all logs
BYTES_IN_FLIGHT = 100_000  # more bytes than a vehicle sends before it receives the end request
DATAFLASH_HEAD, ULOG_HEAD = b"\xa3\x95\x80", b"ULog\x01\x12\x35"


def _entries(vehicle: VehicleUnderTest) -> dict[int, Any]:
    """Return LOG_ENTRY by log id.

    Without an answer: raise CheckFailed if the autopilot is known, else Skip.
    """
    mark = vehicle.mark()
    for _ in range(3):
        vehicle.send(mavlink.MAVLink_log_request_list_message(*vehicle.target, 0, 0xFFFF))
        if vehicle.wait_for("LOG_ENTRY", within_s=LIST_S, mark=mark) is not None:
            break
    else:
        if vehicle.dialect.is_known:
            raise CheckFailed("expected LOG_ENTRY for LOG_REQUEST_LIST, saw none")
        raise Skip("the vehicle does not answer LOG_REQUEST_LIST")
    total = vehicle.since(mark, "LOG_ENTRY")[0].num_logs
    for _ in range(20):
        found = {m.id: m for m in vehicle.since(mark, "LOG_ENTRY") if m.num_logs}
        if len(found) >= total:
            return found
        vehicle.wait(0.5)
    raise CheckFailed(f"expected {total} LOG_ENTRY messages within 10 s, saw {len(found)}")


def _newest(vehicle: VehicleUnderTest) -> Any:
    """Return the LOG_ENTRY of the log with content and the highest id; raise Skip if there is none."""
    found = [entry for entry in _entries(vehicle).values() if entry.size > 0]
    if not found:
        raise Skip("the vehicle has no log with content")
    return max(found, key=lambda entry: entry.id)


def _is_data(log_id: int, offset: int) -> Condition:
    return lambda m: bool(m.id == log_id and m.ofs == offset)


def _data(vehicle: VehicleUnderTest, log_id: int, offset: int, count: int) -> bytes:
    """Return up to `count` bytes of a log.

    The result is shorter at the end of the log, and if a part is still missing after `REQUESTS` requests.
    """
    found = bytearray()
    for _ in range(REQUESTS):
        if len(found) >= count:
            break
        request = log_id, offset + len(found), count - len(found)
        mark = vehicle.mark()
        vehicle.send(mavlink.MAVLink_log_request_data_message(*vehicle.target, *request))
        while len(found) < count:
            is_next = _is_data(log_id, offset + len(found))
            message = vehicle.wait_for("LOG_DATA", is_next, mark=mark)
            if message is None:  # lost
                break
            found += bytes(message.data[: message.count])
            if message.count < CHUNK:  # the end of the log
                return bytes(found)
    return bytes(found[:count])


def _end_transfer(vehicle: VehicleUnderTest) -> None:
    """Send LOG_REQUEST_END, so that the vehicle continues logging."""
    vehicle.send(mavlink.MAVLink_log_request_end_message(*vehicle.target))


@check("logs")
def list_(vehicle: VehicleUnderTest) -> str:
    """LOG_REQUEST_LIST brings a LOG_ENTRY for each log; without logs, a LOG_ENTRY with num_logs 0."""
    found = _entries(vehicle)
    _end_transfer(vehicle)
    return f"{len(found)} logs"


@check("logs")
def list_is_consistent(vehicle: VehicleUnderTest) -> str:
    """num_logs is the number of entries; last_log_num is the same in all, and no id exceeds it."""
    found = _entries(vehicle)
    _end_transfer(vehicle)
    if not found:
        raise Skip("the vehicle holds no logs")
    equal({entry.num_logs for entry in found.values()}, {len(found)}, "num_logs")
    equal(len({entry.last_log_num for entry in found.values()}), 1, "number of different last_log_num")
    at_most(max(found), next(iter(found.values())).last_log_num, "greatest id")
    return f"ids {min(found)} to {max(found)}"


@check("logs")
def begins_with_its_format(vehicle: VehicleUnderTest) -> str:
    """A log has the header of a DataFlash log (ArduPilot) or a ULog (PX4)."""
    head = vehicle.known(ardupilot=DATAFLASH_HEAD, px4=ULOG_HEAD)
    entry = _newest(vehicle)
    seen = _data(vehicle, entry.id, 0, 90)
    _end_transfer(vehicle)
    equal(seen[: len(head)], head, "first bytes")
    return str(head[:4].hex(" "))


@check("logs")
def reads_same_twice(vehicle: VehicleUnderTest) -> str:
    """A part of a log has the same bytes in one read as in two reads."""
    entry = _newest(vehicle)
    size = min(PART_BYTES, entry.size)
    one_read = _data(vehicle, entry.id, 0, size)
    two_reads = _data(vehicle, entry.id, 0, 90) + _data(vehicle, entry.id, 90, size - 90)
    _end_transfer(vehicle)
    equal(len(one_read), size, "bytes")
    holds(one_read == two_reads, "the bytes of two reads differ from the bytes of one read")
    return f"{size} bytes of log {entry.id}"


@check("logs")
def end_of_log(vehicle: VehicleUnderTest) -> str:
    """A read beyond the end of a log brings only the bytes up to the size in LOG_ENTRY."""
    entry = _newest(vehicle)
    mark = vehicle.mark()
    seen = _data(vehicle, entry.id, max(0, entry.size - 40), 200)
    vehicle.wait(1.0)
    _end_transfer(vehicle)
    parts = [m for m in vehicle.since(mark, "LOG_DATA") if m.id == entry.id and m.count]
    at_most(max((m.ofs + m.count for m in parts), default=0), entry.size, "end of the last part")
    equal(len(seen), min(40, entry.size), "bytes up to the end")
    return f"{len(seen)} bytes"


@check("logs")
def unknown_id(vehicle: VehicleUnderTest) -> None:
    """A request for a missing log brings no data."""
    _entries(vehicle)  # PX4 sends data only after a list request
    vehicle.send(mavlink.MAVLink_log_request_data_message(*vehicle.target, 60_000, 0, 500))
    received = [m for m in vehicle.listen("LOG_DATA", 2.0) if m.count]
    _end_transfer(vehicle)
    equal(len(received), 0, "LOG_DATA with bytes")


@check("logs")
def download_can_be_ended(vehicle: VehicleUnderTest) -> str:
    """LOG_REQUEST_END ends a download before the end of the log."""
    entry = max(_entries(vehicle).values(), key=lambda found: found.size, default=None)
    if entry is None or entry.size <= BYTES_IN_FLIGHT:
        _end_transfer(vehicle)
        raise Skip(f"the vehicle holds no log of more than {BYTES_IN_FLIGHT // 1000} kB")
    mark = vehicle.mark()
    vehicle.send(mavlink.MAVLink_log_request_data_message(*vehicle.target, entry.id, 0, 0xFFFFFFFF))
    try:
        vehicle.expect("LOG_DATA", lambda m: m.id == entry.id and m.count, within_s=3.0)
    finally:
        with vehicle.extra_time():
            _end_transfer(vehicle)
            vehicle.wait(1.0)
            _end_transfer(vehicle)  # again, because the first request may be lost
            vehicle.wait(1.0)
    received = max(m.ofs + m.count for m in vehicle.since(mark, "LOG_DATA") if m.id == entry.id)
    at_most(received, entry.size - 1, "received bytes")
    vehicle.expect_none("LOG_DATA", during_s=2.0)
    return f"after {received} of {entry.size} bytes"


@check("logs", needs=[ALTER])
def erase(vehicle: VehicleUnderTest) -> str:
    """Within 30 s of LOG_ERASE the vehicle has at most one log, the log in progress."""
    before = len(_entries(vehicle))
    _end_transfer(vehicle)
    vehicle.send(mavlink.MAVLink_log_erase_message(*vehicle.target))
    end_s = vehicle.now + ERASE_S
    while True:
        vehicle.wait(5.0)
        n_left = len(_entries(vehicle))
        _end_transfer(vehicle)
        if n_left <= 1 or vehicle.now > end_s:
            break
    return f"{before} -> {at_most(n_left, 1, 'logs')}"
