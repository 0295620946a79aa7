"""Flight logs: the list, the download, erasing."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import logclient
from sim_vehicle.conformance.assertions import Skip, equal, holds
from sim_vehicle.conformance.guard import ALTER
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

PART_BYTES = 900  # size of the part of a log that is read twice
ERASE_S = 30.0  # longest time for erasing all logs
BYTES_IN_FLIGHT = 100_000  # more bytes than a vehicle sends before it receives the end request
DATAFLASH_HEAD, ULOG_HEAD = b"\xa3\x95\x80", b"ULog\x01\x12\x35"


@check("logs.list")
def log_list(vehicle: VehicleUnderTest) -> str:
    """LOG_REQUEST_LIST brings a LOG_ENTRY for each log; without logs, a LOG_ENTRY with num_logs 0."""
    found = logclient.entries(vehicle)
    logclient.end_transfer(vehicle)
    return f"{len(found)} logs"


@check("logs.list_is_consistent")
def consistent(vehicle: VehicleUnderTest) -> str:
    """num_logs is the number of entries; last_log_num is the same in all, and no id exceeds it."""
    found = logclient.entries(vehicle)
    logclient.end_transfer(vehicle)
    if not found:
        raise Skip("the vehicle holds no logs")
    equal({entry.num_logs for entry in found.values()}, {len(found)}, "num_logs")
    equal(len({entry.last_log_num for entry in found.values()}), 1, "number of different last_log_num")
    last_id = next(iter(found.values())).last_log_num
    holds(max(found) <= last_id, f"id {max(found)} exceeds last_log_num {last_id}")
    return f"ids {min(found)} to {max(found)}"


@check("logs.begins_with_its_format")
def begins(vehicle: VehicleUnderTest) -> str:
    """A log has the header of a DataFlash log (ArduPilot) or a ULog (PX4)."""
    head = vehicle.known(ardupilot=DATAFLASH_HEAD, px4=ULOG_HEAD)
    entry = logclient.newest(vehicle)
    seen = logclient.data(vehicle, entry.id, 0, 90)
    logclient.end_transfer(vehicle)
    equal(seen[: len(head)], head, "first bytes")
    return str(head[:4].hex(" "))


@check("logs.reads_same_twice", limit_s=120)
def same_in_one_or_two_reads(vehicle: VehicleUnderTest) -> str:
    """A part of a log has the same bytes in one read as in two reads."""
    entry = logclient.newest(vehicle)
    size = min(PART_BYTES, entry.size)
    one_read = logclient.data(vehicle, entry.id, 0, size)
    two_reads = logclient.data(vehicle, entry.id, 0, 90) + logclient.data(vehicle, entry.id, 90, size - 90)
    logclient.end_transfer(vehicle)
    equal(len(one_read), size, "bytes")
    holds(one_read == two_reads, "the bytes of two reads differ from the bytes of one read")
    return f"{size} bytes of log {entry.id}"


@check("logs.end_of_log", limit_s=120)
def end_of_log(vehicle: VehicleUnderTest) -> str:
    """A read beyond the end of a log brings only the bytes up to the size in LOG_ENTRY."""
    entry = logclient.newest(vehicle)
    seen = logclient.data(vehicle, entry.id, max(0, entry.size - 40), 200)
    logclient.end_transfer(vehicle)
    equal(len(seen), min(40, entry.size), "bytes up to the end")
    return f"{len(seen)} bytes"


@check("logs.unknown_id")
def unknown_id(vehicle: VehicleUnderTest) -> str:
    """A request for a missing log brings no data."""
    logclient.entries(vehicle)  # PX4 sends data only after a list request
    mark = vehicle.send(mavlink.MAVLink_log_request_data_message(*vehicle.target, 60_000, 0, 500))
    vehicle.wait(2.0)
    logclient.end_transfer(vehicle)
    received = [m for m in vehicle.since(mark, "LOG_DATA") if m.count]
    equal(len(received), 0, "LOG_DATA with bytes")
    return "no LOG_DATA with bytes"


@check("logs.download_can_be_ended", limit_s=120)
def download_ends(vehicle: VehicleUnderTest) -> str:
    """LOG_REQUEST_END ends a download before the end of the log."""
    entry = max(logclient.entries(vehicle).values(), key=lambda found: found.size, default=None)
    if entry is None or entry.size <= BYTES_IN_FLIGHT:
        logclient.end_transfer(vehicle)
        raise Skip(f"the vehicle holds no log of more than {BYTES_IN_FLIGHT // 1000} kB")
    mark = vehicle.send(mavlink.MAVLink_log_request_data_message(*vehicle.target, entry.id, 0, 0xFFFFFFFF))
    try:
        vehicle.expect("LOG_DATA", lambda m: m.id == entry.id and m.count, within_s=3.0, mark=mark)
    finally:
        with vehicle.extra_time():
            logclient.end_transfer(vehicle)
            vehicle.wait(1.0)
            logclient.end_transfer(vehicle)  # again, because the first request may be lost
            vehicle.wait(1.0)
    received = max(m.ofs + m.count for m in vehicle.since(mark, "LOG_DATA") if m.id == entry.id)
    holds(received < entry.size, f"the vehicle sent all {entry.size} bytes")
    vehicle.expect_none("LOG_DATA", during_s=2.0)
    return f"after {received} of {entry.size} bytes"


@check("logs.erase", needs=[ALTER], limit_s=90)
def erase(vehicle: VehicleUnderTest) -> str:
    """Within 30 s of LOG_ERASE the vehicle has at most one log, the log in progress."""
    before = len(logclient.entries(vehicle))
    logclient.end_transfer(vehicle)
    vehicle.send(mavlink.MAVLink_log_erase_message(*vehicle.target))
    end_s = vehicle.now + ERASE_S
    while True:
        vehicle.wait(5.0)
        n_left = len(logclient.entries(vehicle))
        logclient.end_transfer(vehicle)
        if n_left <= 1 or vehicle.now > end_s:
            break
    holds(n_left <= 1, f"expected at most 1 log, saw {n_left} of {before}")
    return f"{before} -> {n_left}"
