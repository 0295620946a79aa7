"""Download of flight logs by the log messages."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import CheckFailed, Skip
from sim_vehicle.conformance.vehicle import VehicleUnderTest

CHUNK = 90
LIST_S = 4.0


def entries(vehicle: VehicleUnderTest) -> dict[int, Any]:
    """Return LOG_ENTRY by id; Skip if an unknown autopilot does not answer."""
    mark = vehicle.mark()
    for _ in range(3):
        vehicle.send(mavlink.MAVLink_log_request_list_message(*vehicle.target, 0, 0xFFFF))
        if vehicle.wait_for("LOG_ENTRY", within_s=LIST_S, mark=mark) is not None:
            break
    else:
        if vehicle.dialect.logs:
            raise CheckFailed("expected LOG_ENTRY for LOG_REQUEST_LIST, saw none")
        raise Skip("does not answer LOG_REQUEST_LIST")
    total = vehicle.since(mark, "LOG_ENTRY")[0].num_logs
    for _ in range(20):
        found = {m.id: m for m in vehicle.since(mark, "LOG_ENTRY") if m.num_logs}
        if len(found) >= total:
            return found
        vehicle.wait(0.5)
    raise CheckFailed(f"expected {total} LOG_ENTRY, saw {len(found)}")


def newest(vehicle: VehicleUnderTest) -> Any:
    """Return the LOG_ENTRY of the latest log that is not empty; Skip without one."""
    found = [entry for entry in entries(vehicle).values() if entry.size > 0]
    if not found:
        raise Skip("holds no logs")
    return max(found, key=lambda entry: entry.id)


def data(vehicle: VehicleUnderTest, log_id: int, offset: int, count: int) -> bytes:
    """Return `count` bytes of a log, fewer at its end; request lost parts again."""
    got: dict[int, bytes] = {}
    end: int | None = None
    for _ in range(8):
        at = offset
        while at in got:
            at += len(got[at])
        if at >= offset + count or at == end:
            break
        mark = vehicle.mark()
        vehicle.send(
            mavlink.MAVLink_log_request_data_message(*vehicle.target, log_id, at, offset + count - at)
        )
        while vehicle.wait_for("LOG_DATA", lambda m: m.id == log_id, within_s=1.5, mark=mark) is not None:
            for message in vehicle.since(mark, "LOG_DATA"):
                if message.id == log_id and message.count:
                    got[message.ofs] = bytes(message.data[: message.count])
                if message.id == log_id and message.count < CHUNK:
                    end = message.ofs + message.count
            mark = vehicle.mark()
            if sum(map(len, got.values())) >= count:
                break
    joined = bytearray()
    while offset + len(joined) in got:
        joined += got[offset + len(joined)]
    return bytes(joined[:count])


def end_transfer(vehicle: VehicleUnderTest) -> None:
    """Send LOG_REQUEST_END, after which the vehicle continues logging."""
    vehicle.send(mavlink.MAVLink_log_request_end_message(*vehicle.target))
