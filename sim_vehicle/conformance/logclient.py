"""The flight logs of a vehicle by the log messages."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.peer import Peer
from sim_vehicle.conformance.words import CheckFailed, Skip

CHUNK = 90
LIST_S = 4.0


def entries(peer: Peer) -> dict[int, Any]:
    """LOG_ENTRY by id; Skip where an autopilot nobody knows does not answer."""
    mark = peer.mark()
    for _ in range(3):
        peer.send(mavlink.MAVLink_log_request_list_message(*peer.target, 0, 0xFFFF))
        if peer.maybe("LOG_ENTRY", within_s=LIST_S, mark=mark) is not None:
            break
    else:
        if peer.dialect.logs:
            raise CheckFailed("expected LOG_ENTRY for LOG_REQUEST_LIST, saw none")
        raise Skip("does not answer LOG_REQUEST_LIST")
    total = peer.since(mark, "LOG_ENTRY")[0].num_logs
    for _ in range(20):
        found = {m.id: m for m in peer.since(mark, "LOG_ENTRY") if m.num_logs}
        if len(found) >= total:
            return found
        peer.wait(0.5)
    raise CheckFailed(f"expected {total} LOG_ENTRY, saw {len(found)}")


def newest(peer: Peer) -> Any:
    """The LOG_ENTRY of a log with something in it; Skip without one."""
    found = [entry for entry in entries(peer).values() if entry.size > 0]
    if not found:
        raise Skip("holds no logs")
    return max(found, key=lambda entry: entry.id)


def data(peer: Peer, log_id: int, offset: int, count: int) -> bytes:
    """So many bytes of a log, what is missing asked for again; shorter at its end."""
    got: dict[int, bytes] = {}
    end: int | None = None
    for _ in range(8):
        at = offset
        while at in got:
            at += len(got[at])
        if at >= offset + count or at == end:
            break
        mark = peer.mark()
        peer.send(mavlink.MAVLink_log_request_data_message(*peer.target, log_id, at, offset + count - at))
        while peer.maybe("LOG_DATA", lambda m: m.id == log_id, within_s=1.5, mark=mark) is not None:
            for message in peer.since(mark, "LOG_DATA"):
                if message.id == log_id and message.count:
                    got[message.ofs] = bytes(message.data[: message.count])
                if message.id == log_id and message.count < CHUNK:
                    end = message.ofs + message.count
            mark = peer.mark()
            if sum(map(len, got.values())) >= count:
                break
    joined = bytearray()
    while offset + len(joined) in got:
        joined += got[offset + len(joined)]
    return bytes(joined[:count])


def finish(peer: Peer) -> None:
    """LOG_REQUEST_END: the vehicle may log again."""
    peer.send(mavlink.MAVLink_log_request_end_message(*peer.target))
