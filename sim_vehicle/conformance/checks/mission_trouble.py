"""Interrupted, repeated, disturbed and partial uploads."""

from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import CheckFailed, equal, holds, mission_result_name, near
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour
from sim_vehicle.station.exchanges import REQUESTS
from sim_vehicle.station.plan_items import MISSION

NO_SUCH_COMMAND = 31_900
N_OLD, N_NEW = 7, 5  # items without home: in the earlier mission, in the interrupted upload


@check(
    "mission.trouble.asks_again",
    source="AUTOPILOTS 2: abandoned upload, re-request every 1 s / 0.25 s",
    limit_s=60,
)
def requests_again(vehicle: VehicleUnderTest) -> str:
    """A missing item is requested again: every 1 s by ArduPilot, every 0.25 s by PX4."""
    period_s = known_behaviour(vehicle, ardupilot=1.0, px4=0.25)
    mark = plans.begin_upload(vehicle, plans.sample_plan(vehicle), 2)
    vehicle.wait(3.2)
    times_s = [e.at_s for e in vehicle.received[mark:] if e.kind in REQUESTS]
    holds(len(times_s) >= 2, f"expected requests every {period_s:g} s, saw {len(times_s)} in 3.2 s")
    seen_s = (times_s[-1] - times_s[0]) / (len(times_s) - 1)
    plans.cancel_upload(vehicle)
    near(seen_s, period_s, 0.4 * period_s, "period of requests [s]")
    return f"every {seen_s:.2f} s"


@check("mission.trouble.late_item", limit_s=60)
def late_item(vehicle: VehicleUnderTest) -> str:
    """An upload continues when the missing item arrives after 2 s."""
    items = plans.sample_plan(vehicle)
    plans.begin_upload(vehicle, items, 2)
    mark = vehicle.wait(2.0)
    _, seq = plans.next_request(vehicle, MISSION, mark=mark)
    while True:
        mark = vehicle.mark()
        vehicle.send(items[seq].message(vehicle.target, seq))
        index = vehicle.seek((*REQUESTS, "MISSION_ACK"), plans.for_station(MISSION), within_s=3.0, mark=mark)
        if index is None:
            raise CheckFailed(f"no answer to item {seq}")
        if vehicle.received[index].kind == "MISSION_ACK":
            break
        seq = vehicle.received[index].message.seq
    equal(mission_result_name(vehicle.received[index].message.type), "ACCEPTED", "upload")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return "ACCEPTED"


@check(
    "mission.trouble.gives_up",
    source="AUTOPILOTS 2: after 8 s ACK OPERATION_CANCELLED(15) / 5 s no ACK",
    limit_s=60,
)
def gives_up(vehicle: VehicleUnderTest) -> str:
    """An abandoned upload ends after 8 s (ArduPilot: text and MISSION_ACK) or 5 s (PX4: text only)."""
    after_s, acked = known_behaviour(vehicle, ardupilot=(8.0, True), px4=(5.0, False))
    mark = plans.begin_upload(vehicle, plans.sample_plan(vehicle), 2)
    began_s = vehicle.now
    vehicle.wait(after_s + 3.0)
    last_s = max(e.at_s - began_s for e in vehicle.received[mark:] if e.kind in REQUESTS)
    holds(last_s < after_s + 0.6, f"saw a request after {last_s:.1f} s")
    holds(last_s > after_s - 2.0, f"saw requests for only {last_s:.1f} s")
    acks = [m.type for m in vehicle.since(mark, "MISSION_ACK")]
    equal(acks, [mavlink.MAV_MISSION_OPERATION_CANCELLED] if acked else [], "acknowledgements")
    holds(bool(vehicle.since(mark, "STATUSTEXT")), "expected a text, saw none")
    return f"after {last_s:.1f} s"


@check("mission.trouble.abandoned_upload", source="AUTOPILOTS 2: upload is atomic?", limit_s=60)
def abandoned_upload(vehicle: VehicleUnderTest) -> str:
    """An abandoned upload leaves new and old items on ArduPilot, and the old mission on PX4."""
    atomic = known_behaviour(vehicle, ardupilot=False, px4=True)
    place = plans.current_position(vehicle)
    old = plans.sample_plan(vehicle, N_OLD)
    new = plans.plan(vehicle, *[plans.waypoint(place, -40.0 * i, 10.0) for i in range(1, N_NEW + 1)])
    plans.upload_or_fail(vehicle, old)
    plans.begin_upload(vehicle, new, 3)
    vehicle.wait(11.0 if not atomic else 7.0)
    expected = old if atomic else [*new[:3], *old[3 : len(new)]]
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, expected), "items")
    return "the old mission" if atomic else "3 new, the rest old"


@check("mission.trouble.refused_item", source="AUTOPILOTS 2: a refused upload leaves a mixture")
def refused_item(vehicle: VehicleUnderTest) -> str:
    """A refused last item leaves new and old items on ArduPilot, and the old mission on PX4."""
    atomic = known_behaviour(vehicle, ardupilot=False, px4=True)
    place = plans.current_position(vehicle)
    old = plans.sample_plan(vehicle, N_OLD)
    plans.upload_or_fail(vehicle, old)
    bad = replace(plans.waypoint(place, 10, 10), command=NO_SUCH_COMMAND)
    new = plans.plan(vehicle, plans.waypoint(place, -40, 0), plans.waypoint(place, -80, 0), bad)
    equal(mission_result_name(plans.upload(vehicle, new).result), "UNSUPPORTED", "upload")
    expected = old if atomic else [*new[:-1], *old[len(new) - 1 : len(new)]]
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, expected), "items")
    return "the old mission" if atomic else "a mixture"


@check("mission.trouble.good_after_bad", limit_s=60)
def good_after_bad(vehicle: VehicleUnderTest) -> str:
    """After a refused upload, a valid upload is accepted at once."""
    bad = replace(plans.waypoint(plans.current_position(vehicle), 10, 10), command=NO_SUCH_COMMAND)
    plans.upload(vehicle, plans.plan(vehicle, plans.takeoff(plans.current_position(vehicle)), bad))
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return "ACCEPTED"


@check("mission.trouble.cancelled", limit_s=60)
def cancelled(vehicle: VehicleUnderTest) -> str:
    """After a cancelled upload the next upload is accepted."""
    plans.begin_upload(vehicle, plans.sample_plan(vehicle), 2)
    plans.cancel_upload(vehicle)
    items = plans.sample_plan(vehicle, 4)
    plans.upload_or_fail(vehicle, items)
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return "ACCEPTED"


@check("mission.trouble.duplicate_item", source="AUTOPILOTS 2: wrong / duplicate item", limit_s=60)
def duplicate_item(vehicle: VehicleUnderTest) -> str:
    """ArduPilot answers a repeated item with INVALID_SEQUENCE, PX4 ignores it; the upload continues."""
    is_answered = known_behaviour(vehicle, ardupilot=True, px4=False)
    items = plans.sample_plan(vehicle)
    mark, repeated, n_answers = vehicle.mark(), False, 0
    vehicle.send(plans.count_message(vehicle, len(items)))
    while True:
        index = vehicle.seek((*REQUESTS, "MISSION_ACK"), plans.for_station(MISSION), within_s=3.0, mark=mark)
        if index is None:
            raise CheckFailed("the vehicle neither requested nor acknowledged within 3 s")
        entry, mark = vehicle.received[index], index + 1
        if entry.kind == "MISSION_ACK":
            if entry.message.type != mavlink.MAV_MISSION_INVALID_SEQUENCE:
                break
            n_answers += 1
            continue
        seq = entry.message.seq
        vehicle.send(items[seq].message(vehicle.target, seq))
        if seq == 1 and not repeated:
            repeated = True
            vehicle.send(items[seq].message(vehicle.target, seq))
    equal(mission_result_name(entry.message.type), "ACCEPTED", "upload")
    equal(n_answers > 0, is_answered, "INVALID_SEQUENCE received")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return f"{n_answers} INVALID_SEQUENCE, then ACCEPTED"


@check(
    "mission.trouble.last_item_again",
    source="AUTOPILOTS 2: a repeated last item -> ERROR(1) / ACCEPTED again",
)
def last_item_again(vehicle: VehicleUnderTest) -> str:
    """A last item, repeated as after a lost MISSION_ACK, is answered ERROR (ArduPilot) or ACCEPTED (PX4)."""
    expected = known_behaviour(vehicle, ardupilot="ERROR", px4="ACCEPTED")
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    mark, last = vehicle.mark(), len(items) - 1
    vehicle.send(items[last].message(vehicle.target, last))
    ack = vehicle.expect("MISSION_ACK", plans.for_station(MISSION), mark=mark)
    equal(mission_result_name(ack.type), expected, "the last item again")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return str(expected)


@check(
    "mission.trouble.second_station",
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: DENIED(14) both",
    limit_s=60,
)
def second_station(vehicle: VehicleUnderTest) -> str:
    """During an upload, MISSION_COUNT of a second station is answered DENIED."""
    items = plans.sample_plan(vehicle)
    plans.begin_upload(vehicle, items, 2)
    mark = vehicle.mark()
    vehicle.send(plans.count_message(vehicle, 3), SECOND_STATION)
    ack = vehicle.expect("MISSION_ACK", plans.for_station(MISSION, SECOND_STATION), mark=mark)
    plans.cancel_upload(vehicle)
    equal(mission_result_name(ack.type), "DENIED", "the other station's upload")
    return "DENIED"


@check(
    "mission.trouble.download_during_upload",
    source="AUTOPILOTS 2: second GCS / download during upload",
    limit_s=60,
)
def download_during_upload(vehicle: VehicleUnderTest) -> str:
    """During an upload, ArduPilot answers MISSION_REQUEST_LIST with DENIED; PX4 does not answer."""
    denied = known_behaviour(vehicle, ardupilot=True, px4=False)
    plans.begin_upload(vehicle, plans.sample_plan(vehicle), 2)
    mark = vehicle.mark()
    vehicle.send(plans.request_list(vehicle))
    vehicle.wait(1.0)
    acks, counts = vehicle.since(mark, "MISSION_ACK"), vehicle.since(mark, "MISSION_COUNT")
    plans.cancel_upload(vehicle)
    equal(counts, [], "MISSION_COUNT")
    equal([mission_result_name(a.type) for a in acks], ["DENIED"] if denied else [], "acknowledgements")
    return "DENIED" if denied else "no answer"


@check(
    "mission.trouble.same_station_restarts",
    dialects=("ardupilot",),
    source="AUTOPILOTS 2: same GCS may restart",
)
def same_station_restarts(vehicle: VehicleUnderTest) -> str:
    """The uploading station may restart its upload."""
    plans.begin_upload(vehicle, plans.sample_plan(vehicle, 6), 2)
    items = plans.sample_plan(vehicle, 4)
    done = plans.upload(vehicle, items)
    equal(mission_result_name(done.result), "ACCEPTED", "upload")
    equal(done.requests[0][1], 0, "the first request")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return "ACCEPTED"


def _write_partial(vehicle: VehicleUnderTest, first: int, last: int) -> int:
    mark = vehicle.mark()
    vehicle.send(mavlink.MAVLink_mission_write_partial_list_message(*vehicle.target, first, last, MISSION))
    return mark


@check("mission.partial.writes", source="AUTOPILOTS 2: MISSION_WRITE_PARTIAL_LIST (38)")
def partial_writes(vehicle: VehicleUnderTest) -> str:
    """MISSION_WRITE_PARTIAL_LIST replaces items 2 and 3 on ArduPilot; PX4 does not answer."""
    works = known_behaviour(vehicle, ardupilot=True, px4=False)
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    mark = _write_partial(vehicle, 2, 3)
    if not works:
        vehicle.wait(1.5)
        equal(
            [e.kind for e in vehicle.received[mark:] if e.kind in (*REQUESTS, "MISSION_ACK")],
            [],
            "answers",
        )
        return "no answer"
    for seq in (2, 3):
        items[seq] = plans.waypoint(plans.current_position(vehicle), -50.0 * seq, 0)
        equal(plans.next_request(vehicle, MISSION, mark=mark)[1], seq, "requested item")
        mark = vehicle.mark()
        vehicle.send(items[seq].message(vehicle.target, seq))
    ack = vehicle.expect("MISSION_ACK", plans.for_station(MISSION), mark=mark)
    equal(mission_result_name(ack.type), "ACCEPTED", "partial write")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return "ACCEPTED"


@check("mission.partial.appends", dialects=("ardupilot",), source="AUTOPILOTS 2: may append at start=count")
def partial_appends(vehicle: VehicleUnderTest) -> str:
    """A partial write that begins directly after the last item appends an item."""
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    seq = len(items)
    mark = _write_partial(vehicle, seq, seq)
    equal(plans.next_request(vehicle, MISSION, mark=mark)[1], seq, "requested item")
    items.append(plans.waypoint(plans.current_position(vehicle), -90, 0))
    mark = vehicle.mark()
    vehicle.send(items[seq].message(vehicle.target, seq))
    equal(vehicle.expect("MISSION_ACK", mark=mark).type, mavlink.MAV_MISSION_ACCEPTED, "partial write")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return f"{len(items)} items"


@check("mission.partial.bad_range", dialects=("ardupilot",), source="AUTOPILOTS 2: bad range ERROR(1)")
def partial_bad_range(vehicle: VehicleUnderTest) -> str:
    """A partial write that would leave a gap after the last item is answered ERROR."""
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    mark = _write_partial(vehicle, len(items) + 5, len(items) + 6)
    ack = vehicle.expect("MISSION_ACK", plans.for_station(MISSION), mark=mark)
    equal(mission_result_name(ack.type), "ERROR", "partial write")
    return "ERROR"
