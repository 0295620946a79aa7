"""Uploads that are interrupted, repeated, disturbed, or done in part."""

from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.peer import SECOND_STATION, Peer, known
from sim_vehicle.conformance.plans import MISSION
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, equal, holds, mission_result_name, near

NO_SUCH_ITEM = 31_900
OLD, NEW = 7, 5  # items beside home of the mission that was there, and of the one that is interrupted


@check(
    "mission.trouble.asks_again",
    pins="AUTOPILOTS 2: abandoned upload, re-request every 1 s / 0.25 s",
    limit_s=60,
)
def asks_again(peer: Peer) -> str:
    """An item that does not come is asked for again: each second by ArduPilot, four times a second by PX4."""
    period_s = known(peer, ardupilot=1.0, px4=0.25)
    mark = plans.begin(peer, plans.sample_plan(peer), 2)
    peer.wait(3.2)
    times = [e.at_s for e in peer.heard[mark:] if e.kind in plans.REQUESTS]
    holds(len(times) >= 2, f"expected requests every {period_s:g} s, saw {len(times)} in 3 s")
    seen_s = (times[-1] - times[0]) / (len(times) - 1)
    plans.cancel(peer)
    near(seen_s, period_s, 0.4 * period_s, "seconds between requests")
    return f"every {seen_s:.2f} s"


@check("mission.trouble.late_item", limit_s=60)
def late_item(peer: Peer) -> str:
    """An upload goes on when the missing item comes after two seconds."""
    items = plans.sample_plan(peer)
    plans.begin(peer, items, 2)
    mark = peer.wait(2.0)
    _, seq = plans.next_request(peer, MISSION, mark=mark)
    while True:
        mark = peer.mark()
        peer.send(items[seq].message(peer, seq))
        place = peer.seek((*plans.REQUESTS, "MISSION_ACK"), plans.for_us(MISSION), within_s=3.0, mark=mark)
        if place is None:
            raise CheckFailed(f"no answer to item {seq}")
        if peer.heard[place].kind == "MISSION_ACK":
            break
        seq = peer.heard[place].message.seq
    equal(mission_result_name(peer.heard[place].message.type), "ACCEPTED", "upload")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return "ACCEPTED"


@check(
    "mission.trouble.gives_up",
    pins="AUTOPILOTS 2: after 8 s ACK OPERATION_CANCELLED(15) / 5 s no ACK",
    limit_s=60,
)
def gives_up(peer: Peer) -> str:
    """An abandoned upload ends: after 8 s with an acknowledgement, or after 5 s with a text alone."""
    after_s, acked = known(peer, ardupilot=(8.0, True), px4=(5.0, False))
    mark = plans.begin(peer, plans.sample_plan(peer), 2)
    began_s = peer.now
    peer.wait(after_s + 3.0)
    requests = [e.at_s - began_s for e in peer.heard[mark:] if e.kind in plans.REQUESTS]
    holds(max(requests) < after_s + 0.6, f"still asked after {max(requests):.1f} s")
    holds(max(requests) > after_s - 2.0, f"asked for only {max(requests):.1f} s")
    acks = [m.type for m in peer.since(mark, "MISSION_ACK")]
    equal(acks, [mavlink.MAV_MISSION_OPERATION_CANCELLED] if acked else [], "acknowledgements")
    holds(bool(peer.since(mark, "STATUSTEXT")), "expected a text, saw none")
    return f"after {max(requests):.1f} s"


@check("mission.trouble.abandoned_upload", pins="AUTOPILOTS 2: upload is atomic?", limit_s=60)
def abandoned_upload(peer: Peer) -> str:
    """What an abandoned upload leaves: a mixture of new and old (ArduPilot), or the old mission (PX4)."""
    atomic = known(peer, ardupilot=False, px4=True)
    place = plans.here(peer)
    old = plans.sample_plan(peer, OLD)
    new = plans.plan(peer, *[plans.waypoint(place, -40.0 * i, 10.0) for i in range(1, NEW + 1)])
    plans.put(peer, old)
    plans.begin(peer, new, 3)
    peer.wait(11.0 if not atomic else 7.0)
    expected = old if atomic else [*new[:3], *old[3 : len(new)]]
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, expected), "items")
    return "the old mission" if atomic else "3 new, the rest old"


@check("mission.trouble.refused_item", pins="AUTOPILOTS 2: a refused upload leaves a mixture")
def refused_item(peer: Peer) -> str:
    """What an upload that is refused at its last item leaves: a mixture, or the old mission."""
    atomic = known(peer, ardupilot=False, px4=True)
    place = plans.here(peer)
    old = plans.sample_plan(peer, OLD)
    plans.put(peer, old)
    bad = replace(plans.waypoint(place, 10, 10), command=NO_SUCH_ITEM)
    new = plans.plan(peer, plans.waypoint(place, -40, 0), plans.waypoint(place, -80, 0), bad)
    equal(mission_result_name(plans.upload(peer, new).result), "UNSUPPORTED", "upload")
    expected = old if atomic else [*new[:-1], *old[len(new) - 1 : len(new)]]
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, expected), "items")
    return "the old mission" if atomic else "a mixture"


@check("mission.trouble.good_after_bad", limit_s=60)
def good_after_bad(peer: Peer) -> str:
    """After a refusal a clean upload is accepted at once."""
    bad = replace(plans.waypoint(plans.here(peer), 10, 10), command=NO_SUCH_ITEM)
    plans.upload(peer, plans.plan(peer, plans.takeoff(plans.here(peer)), bad))
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return "ACCEPTED"


@check("mission.trouble.cancelled", limit_s=60)
def cancelled(peer: Peer) -> str:
    """After the station has cancelled an upload the next one is accepted."""
    plans.begin(peer, plans.sample_plan(peer), 2)
    plans.cancel(peer)
    items = plans.sample_plan(peer, 4)
    plans.put(peer, items)
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return "ACCEPTED"


@check("mission.trouble.duplicate_item", pins="AUTOPILOTS 2: wrong / duplicate item", limit_s=60)
def duplicate_item(peer: Peer) -> str:
    """An item sent twice: INVALID_SEQUENCE from ArduPilot, nothing from PX4; the upload goes on."""
    complains = known(peer, ardupilot=True, px4=False)
    items = plans.sample_plan(peer)
    mark, doubled, complaints = peer.mark(), False, 0
    peer.send(plans.count_message(peer, len(items)))
    while True:
        place = peer.seek((*plans.REQUESTS, "MISSION_ACK"), plans.for_us(MISSION), within_s=3.0, mark=mark)
        if place is None:
            raise CheckFailed("the upload stopped")
        entry, mark = peer.heard[place], place + 1
        if entry.kind == "MISSION_ACK":
            if entry.message.type != mavlink.MAV_MISSION_INVALID_SEQUENCE:
                break
            complaints += 1
            continue
        seq = entry.message.seq
        peer.send(items[seq].message(peer, seq))
        if seq == 1 and not doubled:
            doubled = True
            peer.send(items[seq].message(peer, seq))
    equal(mission_result_name(entry.message.type), "ACCEPTED", "upload")
    equal(complaints > 0, complains, "INVALID_SEQUENCE")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return f"{complaints} complaints, then ACCEPTED"


@check(
    "mission.trouble.last_item_again", pins="AUTOPILOTS 2: a repeated last item -> ERROR(1) / ACCEPTED again"
)
def last_item_again(peer: Peer) -> str:
    """The last item again, as after a lost acknowledgement: ERROR from ArduPilot, ACCEPTED from PX4."""
    expected = known(peer, ardupilot="ERROR", px4="ACCEPTED")
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    mark, last = peer.mark(), len(items) - 1
    peer.send(items[last].message(peer, last))
    ack = peer.expect("MISSION_ACK", plans.for_us(MISSION), mark=mark)
    equal(mission_result_name(ack.type), expected, "the last item again")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return str(expected)


@check(
    "mission.trouble.second_station",
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: DENIED(14) both",
    limit_s=60,
)
def second_station(peer: Peer) -> str:
    """While one station uploads, another's announcement is DENIED."""
    items = plans.sample_plan(peer)
    plans.begin(peer, items, 2)
    mark = peer.mark()
    peer.send(plans.count_message(peer, 3), SECOND_STATION)
    ack = peer.expect("MISSION_ACK", plans.for_us(MISSION, SECOND_STATION), mark=mark)
    plans.cancel(peer)
    equal(mission_result_name(ack.type), "DENIED", "the other station's upload")
    return "DENIED"


@check(
    "mission.trouble.download_during_upload",
    pins="AUTOPILOTS 2: second GCS / download during upload",
    limit_s=60,
)
def download_during_upload(peer: Peer) -> str:
    """A list request during an upload is DENIED by ArduPilot and not answered by PX4."""
    denied = known(peer, ardupilot=True, px4=False)
    plans.begin(peer, plans.sample_plan(peer), 2)
    mark = peer.mark()
    peer.send(plans.request_list(peer))
    peer.wait(1.0)
    acks, counts = peer.since(mark, "MISSION_ACK"), peer.since(mark, "MISSION_COUNT")
    plans.cancel(peer)
    equal(counts, [], "MISSION_COUNT")
    equal([mission_result_name(a.type) for a in acks], ["DENIED"] if denied else [], "acknowledgements")
    return "DENIED" if denied else "no answer"


@check(
    "mission.trouble.same_station_restarts",
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: same GCS may restart",
)
def same_station_restarts(peer: Peer) -> str:
    """The station that uploads may begin again."""
    plans.begin(peer, plans.sample_plan(peer, 6), 2)
    items = plans.sample_plan(peer, 4)
    done = plans.upload(peer, items)
    equal(mission_result_name(done.result), "ACCEPTED", "upload")
    equal(done.requests[0][1], 0, "the first request")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return "ACCEPTED"


def _write_partial(peer: Peer, first: int, last: int) -> int:
    mark = peer.mark()
    peer.send(mavlink.MAVLink_mission_write_partial_list_message(*peer.target, first, last, MISSION))
    return mark


@check("mission.partial.writes", pins="AUTOPILOTS 2: MISSION_WRITE_PARTIAL_LIST (38)")
def partial_writes(peer: Peer) -> str:
    """Items 2 and 3 are replaced by ArduPilot; PX4 does not answer at all."""
    works = known(peer, ardupilot=True, px4=False)
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    mark = _write_partial(peer, 2, 3)
    if not works:
        peer.wait(1.5)
        equal(
            [e.kind for e in peer.heard[mark:] if e.kind in (*plans.REQUESTS, "MISSION_ACK")], [], "answers"
        )
        return "no answer"
    for seq in (2, 3):
        items[seq] = plans.waypoint(plans.here(peer), -50.0 * seq, 0)
        equal(plans.next_request(peer, MISSION, mark=mark)[1], seq, "asked for")
        mark = peer.mark()
        peer.send(items[seq].message(peer, seq))
    ack = peer.expect("MISSION_ACK", plans.for_us(MISSION), mark=mark)
    equal(mission_result_name(ack.type), "ACCEPTED", "partial write")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return "ACCEPTED"


@check("mission.partial.appends", dialects=("ardupilot",), pins="AUTOPILOTS 2: may append at start=count")
def partial_appends(peer: Peer) -> str:
    """A partial write that begins at the end appends."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    seq = len(items)
    mark = _write_partial(peer, seq, seq)
    equal(plans.next_request(peer, MISSION, mark=mark)[1], seq, "asked for")
    items.append(plans.waypoint(plans.here(peer), -90, 0))
    mark = peer.mark()
    peer.send(items[seq].message(peer, seq))
    equal(peer.expect("MISSION_ACK", mark=mark).type, mavlink.MAV_MISSION_ACCEPTED, "partial write")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return f"{len(items)} items"


@check("mission.partial.bad_range", dialects=("ardupilot",), pins="AUTOPILOTS 2: bad range ERROR(1)")
def partial_bad_range(peer: Peer) -> str:
    """A partial write behind the end is an ERROR."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    mark = _write_partial(peer, len(items) + 5, len(items) + 6)
    ack = peer.expect("MISSION_ACK", plans.for_us(MISSION), mark=mark)
    equal(mission_result_name(ack.type), "ERROR", "partial write")
    return "ERROR"
