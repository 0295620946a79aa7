"""Download of flight logs by the log messages."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import CheckFailed, Skip
from sim_vehicle.conformance.vehicle import VehicleUnderTest

CHUNK = 90  # bytes of data in a full LOG_DATA
LIST_S = 4.0  # longest wait for the first LOG_ENTRY after a request


def entries(vehicle: VehicleUnderTest) -> dict[int, Any]:
    """Return LOG_ENTRY by log id.

    Without an answer: raise CheckFailed if the autopilot is known to serve logs (`dialect.logs`), else Skip.
    """
    mark = vehicle.mark()
    for _ in range(3):
        vehicle.send(mavlink.MAVLink_log_request_list_message(*vehicle.target, 0, 0xFFFF))
        if vehicle.wait_for("LOG_ENTRY", within_s=LIST_S, mark=mark) is not None:
            break
    else:
        if vehicle.dialect.logs:
            raise CheckFailed("expected LOG_ENTRY for LOG_REQUEST_LIST, saw none")
        raise Skip("the vehicle does not answer LOG_REQUEST_LIST")
    total = vehicle.since(mark, "LOG_ENTRY")[0].num_logs
    for _ in range(20):
        found = {m.id: m for m in vehicle.since(mark, "LOG_ENTRY") if m.num_logs}
        if len(found) >= total:
            return found
        vehicle.wait(0.5)
    raise CheckFailed(f"expected {total} LOG_ENTRY messages within 10 s, saw {len(found)}")


def newest(vehicle: VehicleUnderTest) -> Any:
    """Return the LOG_ENTRY of the log with content and the highest id; raise Skip if there is none."""
    found = [entry for entry in entries(vehicle).values() if entry.size > 0]
    if not found:
        raise Skip("the vehicle has no log with content")
    return max(found, key=lambda entry: entry.id)


def data(vehicle: VehicleUnderTest, log_id: int, offset: int, count: int) -> bytes:
    """Return up to `count` bytes of a log.

    The result is shorter at the end of the log, and if a part is still missing after eight requests.
    """
    parts: dict[int, bytes] = {}
    end: int | None = None
    for _ in range(8):
        start = offset
        while start in parts:
            start += len(parts[start])
        if start >= offset + count or start == end:
            break
        mark = vehicle.mark()
        vehicle.send(
            mavlink.MAVLink_log_request_data_message(*vehicle.target, log_id, start, offset + count - start)
        )
        while vehicle.wait_for("LOG_DATA", lambda m: m.id == log_id, within_s=1.5, mark=mark) is not None:
            for message in vehicle.since(mark, "LOG_DATA"):
                if message.id == log_id and message.count:
                    parts[message.ofs] = bytes(message.data[: message.count])
                if message.id == log_id and message.count < CHUNK:
                    end = message.ofs + message.count
            mark = vehicle.mark()
            if sum(map(len, parts.values())) >= count:
                break
    joined = bytearray()
    while offset + len(joined) in parts:
        joined += parts[offset + len(joined)]
    return bytes(joined[:count])


def end_transfer(vehicle: VehicleUnderTest) -> None:
    """Send LOG_REQUEST_END, so that the vehicle continues logging."""
    vehicle.send(mavlink.MAVLink_log_request_end_message(*vehicle.target))
