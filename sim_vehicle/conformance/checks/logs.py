"""Flight logs: the list, the download, erasing."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import logclient
from sim_vehicle.conformance.guard import ALTER
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import Skip, equal, holds

PART = 900
UNDER_WAY = 100_000  # bytes: more than may have been sent before the vehicle hears that it shall stop
DATAFLASH_HEAD, ULOG_HEAD = b"\xa3\x95\x80", b"ULog\x01\x12\x35"


@check("logs.list")
def log_list(peer: Peer) -> str:
    """LOG_REQUEST_LIST is answered by one LOG_ENTRY a log, or one that says there is none."""
    found = logclient.entries(peer)
    logclient.finish(peer)
    return f"{len(found)} logs"


@check("logs.list_is_consistent")
def consistent(peer: Peer) -> str:
    """Every entry has the same num_logs and last_log_num, and an id up to that."""
    found = logclient.entries(peer)
    logclient.finish(peer)
    if not found:
        raise Skip("holds no logs")
    equal({entry.num_logs for entry in found.values()}, {len(found)}, "num_logs")
    equal(len({entry.last_log_num for entry in found.values()}), 1, "different last_log_num")
    last = next(iter(found.values())).last_log_num
    holds(max(found) <= last, f"id {max(found)} above last_log_num {last}")
    return f"ids {min(found)} to {max(found)}"


@check("logs.begins_with_its_format")
def begins(peer: Peer) -> str:
    """A log begins like a DataFlash log (ArduPilot) or a ULog (PX4)."""
    head = known(peer, ardupilot=DATAFLASH_HEAD, px4=ULOG_HEAD)
    entry = logclient.newest(peer)
    seen = logclient.data(peer, entry.id, 0, 90)
    logclient.finish(peer)
    equal(seen[: len(head)], head, "first bytes")
    return str(head[:4].hex(" "))


@check("logs.reads_same_twice", limit_s=120)
def same_twice(peer: Peer) -> str:
    """A part of a log reads the same again, whole and in two halves."""
    entry = logclient.newest(peer)
    size = min(PART, entry.size)
    whole = logclient.data(peer, entry.id, 0, size)
    halves = logclient.data(peer, entry.id, 0, 90) + logclient.data(peer, entry.id, 90, size - 90)
    logclient.finish(peer)
    equal(len(whole), size, "bytes")
    holds(whole == halves, "the parts differ from the whole")
    return f"{size} bytes of log {entry.id}"


@check("logs.ends_short", limit_s=120)
def ends_short(peer: Peer) -> str:
    """At the end of a log comes a short piece: there is nothing behind its size."""
    entry = logclient.newest(peer)
    seen = logclient.data(peer, entry.id, max(0, entry.size - 40), 200)
    logclient.finish(peer)
    equal(len(seen), min(40, entry.size), "bytes up to the end")
    return f"{len(seen)} bytes"


@check("logs.unknown_id")
def unknown_id(peer: Peer) -> str:
    """Data of a log that is not there does not come."""
    logclient.entries(peer)  # PX4 gives data only to who has asked for the list
    mark = peer.mark()
    peer.send(mavlink.MAVLink_log_request_data_message(*peer.target, 60_000, 0, 500))
    peer.wait(2.0)
    logclient.finish(peer)
    got = [m for m in peer.since(mark, "LOG_DATA") if m.count]
    equal(len(got), 0, "LOG_DATA with bytes")
    return "none"


@check("logs.download_can_be_ended", limit_s=120)
def download_ends(peer: Peer) -> str:
    """LOG_REQUEST_END in the middle of a download ends it."""
    entry = max(logclient.entries(peer).values(), key=lambda found: found.size, default=None)
    if entry is None or entry.size <= UNDER_WAY:
        logclient.finish(peer)
        raise Skip(f"holds no log of more than {UNDER_WAY // 1000} kB, which could be ended on its way")
    mark = peer.mark()
    peer.send(mavlink.MAVLink_log_request_data_message(*peer.target, entry.id, 0, 0xFFFFFFFF))
    try:
        peer.expect("LOG_DATA", lambda m: m.id == entry.id and m.count, within_s=3.0, mark=mark)
    finally:
        with peer.tidying():
            logclient.finish(peer)
            peer.wait(1.0)
            logclient.finish(peer)  # the first may have been lost
            peer.wait(1.0)
    got = max(m.ofs + m.count for m in peer.since(mark, "LOG_DATA") if m.id == entry.id)
    holds(got < entry.size, f"all {entry.size} bytes came")
    peer.none("LOG_DATA", during_s=2.0)
    return f"after {got} of {entry.size} bytes"


@check("logs.erase", needs=[ALTER], limit_s=90)
def erase(peer: Peer) -> str:
    """LOG_ERASE removes the logs, at most the one being written stays."""
    before = len(logclient.entries(peer))
    logclient.finish(peer)
    peer.send(mavlink.MAVLink_log_erase_message(*peer.target))
    peer.wait(5.0)
    left = len(logclient.entries(peer))
    logclient.finish(peer)
    holds(left <= 1, f"expected at most 1 log, saw {left} of {before}")
    return f"{before} -> {left}"
