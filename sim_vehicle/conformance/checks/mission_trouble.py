"""Interrupted, repeated, disturbed and partial uploads."""

from dataclasses import replace
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import at_least, equal, holds, near, within
from sim_vehicle.conformance.outcomes import ACCEPTED, mission_result_name
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.exchanges import REQUESTS
from sim_vehicle.station.messages import MISSION, PlanItem

NO_SUCH_COMMAND = 31_900
N_OLD, N_NEW = 7, 5  # items without home: in the earlier mission, in the interrupted upload
_ardupilot_check = partial(check, dialects=("ardupilot",))


def _begin(vehicle: VehicleUnderTest) -> None:
    """Upload two items of a mission; the next request remains unanswered."""
    plans.begin_upload(vehicle, plans.sample_plan(vehicle), 2)


def _bad_item(vehicle: VehicleUnderTest) -> PlanItem:
    return replace(plans.waypoint(plans.current_position(vehicle), 10, 10), command=NO_SUCH_COMMAND)


@check("mission.trouble", source="AUTOPILOTS 2: abandoned upload, re-request every 1 s / 0.25 s")
def asks_again(vehicle: VehicleUnderTest) -> str:
    """A missing item is requested again: every 1 s by ArduPilot, every 0.25 s by PX4."""
    period_s = vehicle.known(ardupilot=1.0, px4=0.25)
    _begin(vehicle)
    times_s = [e.at_s for e in vehicle.wait(3.2) if e.kind in REQUESTS]
    at_least(len(times_s), 2, "requests in 3.2 s")
    seen_s = (times_s[-1] - times_s[0]) / (len(times_s) - 1)
    plans.cancel_upload(vehicle)
    return f"every {near(seen_s, period_s, 0.4 * period_s, 'period of requests [s]'):.2f} s"


@check("mission.trouble")
def late_item(vehicle: VehicleUnderTest) -> str:
    """An upload continues when the missing item arrives after 2 s."""
    items = plans.sample_plan(vehicle)
    plans.begin_upload(vehicle, items, 2)
    mark = vehicle.mark()
    vehicle.wait(2.0)
    entry, _ = plans.next_step(vehicle, mark)
    while entry.kind != "MISSION_ACK":
        plans.send_item(vehicle, items, entry.message.seq)
        entry, _ = plans.next_step(vehicle)
    plans.expect_stored(vehicle, items)
    return equal(mission_result_name(entry.message.type), ACCEPTED, "upload")


@check("mission.trouble", source="AUTOPILOTS 2: after 8 s ACK OPERATION_CANCELLED(15) / 5 s no ACK")
def gives_up(vehicle: VehicleUnderTest) -> str:
    """An abandoned upload ends after 8 s (ArduPilot: text and MISSION_ACK) or 5 s (PX4: text only)."""
    after_s, answers = vehicle.known(ardupilot=(8.0, ["OPERATION_CANCELLED"]), px4=(5.0, []))
    _begin(vehicle)
    mark, began_s = vehicle.mark(), vehicle.now
    last_s = max(e.at_s - began_s for e in vehicle.wait(after_s + 3.0) if e.kind in REQUESTS)
    within(last_s, after_s - 2.0, after_s + 0.6, "time of the last request [s]")
    acks = [mission_result_name(m.type) for m in vehicle.since(mark, "MISSION_ACK")]
    equal(acks, answers, "acknowledgements")
    vehicle.expect_text("", mark)
    return f"after {last_s:.1f} s"


@check("mission.trouble", source="AUTOPILOTS 2: upload is atomic?")
def abandoned_upload(vehicle: VehicleUnderTest) -> None:
    """An abandoned upload leaves new and old items on ArduPilot, and the old mission on PX4."""
    atomic, ends_s = vehicle.known(ardupilot=(False, 11.0), px4=(True, 7.0))
    place, old = plans.current_position(vehicle), plans.store_sample(vehicle, N_OLD)
    new = plans.plan(vehicle, *[plans.waypoint(place, -40.0 * i, 10.0) for i in range(1, N_NEW + 1)])
    plans.begin_upload(vehicle, new, 3)
    vehicle.wait(ends_s)
    plans.expect_stored(vehicle, old if atomic else [*new[:3], *old[3 : len(new)]])


@check("mission.trouble", source="AUTOPILOTS 2: a refused upload leaves a mixture")
def refused_item(vehicle: VehicleUnderTest) -> None:
    """A refused last item leaves new and old items on ArduPilot, and the old mission on PX4."""
    atomic = vehicle.known(ardupilot=False, px4=True)
    place, old = plans.current_position(vehicle), plans.store_sample(vehicle, N_OLD)
    points = [plans.waypoint(place, north_m, 0) for north_m in (-40, -80)]
    new = plans.plan(vehicle, *points, _bad_item(vehicle))
    equal(plans.upload(vehicle, new).result, "UNSUPPORTED", "upload")
    plans.expect_stored(vehicle, old if atomic else [*new[:-1], *old[len(new) - 1 : len(new)]])


@check("mission.trouble")
def good_after_bad(vehicle: VehicleUnderTest) -> None:
    """After a refused upload, a valid upload is accepted at once."""
    takeoff = plans.takeoff(plans.current_position(vehicle))
    plans.upload(vehicle, plans.plan(vehicle, takeoff, _bad_item(vehicle)))
    plans.store(vehicle, plans.sample_plan(vehicle))


@check("mission.trouble")
def cancelled(vehicle: VehicleUnderTest) -> None:
    """After a cancelled upload the next upload is accepted."""
    _begin(vehicle)
    plans.cancel_upload(vehicle)
    plans.store(vehicle, plans.sample_plan(vehicle, 4))


@check("mission.trouble", source="AUTOPILOTS 2: wrong / duplicate item")
def duplicate_item(vehicle: VehicleUnderTest) -> str:
    """ArduPilot answers a repeated item with INVALID_SEQUENCE, PX4 ignores it; the upload continues."""
    is_answered = vehicle.known(ardupilot=True, px4=False)
    items = plans.sample_plan(vehicle)
    answers: list[str] = []
    repeated = False
    mark = vehicle.mark()
    vehicle.send(plans.count_message(vehicle, len(items)))
    while not answers or answers[-1] == "INVALID_SEQUENCE":
        entry, mark = plans.next_step(vehicle, mark)
        if entry.kind == "MISSION_ACK":
            answers.append(mission_result_name(entry.message.type))
            continue
        plans.send_item(vehicle, items, entry.message.seq)
        if entry.message.seq == 1 and not repeated:
            repeated = True
            plans.send_item(vehicle, items, 1)
    equal(answers[-1], ACCEPTED, "upload")
    equal(len(answers) > 1, is_answered, "INVALID_SEQUENCE received")
    plans.expect_stored(vehicle, items)
    return f"{len(answers) - 1} INVALID_SEQUENCE, then ACCEPTED"


@check("mission.trouble", source="AUTOPILOTS 2: a repeated last item -> ERROR(1) / ACCEPTED again")
def last_item_again(vehicle: VehicleUnderTest) -> str:
    """A last item, repeated as after a lost MISSION_ACK, is answered ERROR (ArduPilot) or ACCEPTED (PX4)."""
    expected = vehicle.known(ardupilot="ERROR", px4=ACCEPTED)
    items = plans.store_sample(vehicle)
    plans.send_item(vehicle, items, len(items) - 1)
    result = plans.next_result(vehicle)
    plans.expect_stored(vehicle, items)
    return equal(result, expected, "the last item again")


@_ardupilot_check("mission.trouble", source="AUTOPILOTS 2: DENIED(14) both")
def second_station(vehicle: VehicleUnderTest) -> str:
    """During an upload, MISSION_COUNT of a second station is answered DENIED."""
    _begin(vehicle)
    vehicle.send(plans.count_message(vehicle, 3), SECOND_STATION)
    result = plans.next_result(vehicle, source=SECOND_STATION)
    plans.cancel_upload(vehicle)
    return equal(result, "DENIED", "the other station's upload")


@check("mission.trouble", source="AUTOPILOTS 2: second GCS / download during upload")
def download_during_upload(vehicle: VehicleUnderTest) -> str:
    """During an upload, ArduPilot answers MISSION_REQUEST_LIST with DENIED; PX4 does not answer."""
    expected = vehicle.known(ardupilot=["DENIED"], px4=[])
    _begin(vehicle)
    vehicle.send(plans.request_list(vehicle))
    frames = vehicle.wait(1.0)
    acks = [mission_result_name(f.message.type) for f in frames if f.kind == "MISSION_ACK"]
    plans.cancel_upload(vehicle)
    holds(not any(f.kind == "MISSION_COUNT" for f in frames), "expected no MISSION_COUNT, saw one")
    return ", ".join(equal(acks, expected, "acknowledgements")) or "no answer"


@_ardupilot_check("mission.trouble", source="AUTOPILOTS 2: same GCS may restart")
def same_station_restarts(vehicle: VehicleUnderTest) -> None:
    """The uploading station may restart its upload."""
    plans.begin_upload(vehicle, plans.sample_plan(vehicle, 6), 2)
    items = plans.sample_plan(vehicle, 4)
    done = plans.upload_or_fail(vehicle, items)
    equal(done.requests[0][1], 0, "the first request")
    plans.expect_stored(vehicle, items)


def _write_partial(vehicle: VehicleUnderTest, first: int, last: int) -> None:
    message = mavlink.MAVLink_mission_write_partial_list_message(*vehicle.target, first, last, MISSION)
    vehicle.send(message)


def _answer_partial(vehicle: VehicleUnderTest, items: list[PlanItem], seqs: range) -> str:
    """Send the items of a partial write as requested; return the result of a mission with these items."""
    for seq in seqs:
        equal(plans.next_request(vehicle), seq, "requested item")
        plans.send_item(vehicle, items, seq)
    result = equal(plans.next_result(vehicle), ACCEPTED, "partial write")
    plans.expect_stored(vehicle, items)
    return result


@check("mission.partial", source="AUTOPILOTS 2: MISSION_WRITE_PARTIAL_LIST (38)")
def writes(vehicle: VehicleUnderTest) -> str:
    """MISSION_WRITE_PARTIAL_LIST replaces items 2 and 3 on ArduPilot; PX4 does not answer."""
    works = vehicle.known(ardupilot=True, px4=False)
    items, place = plans.store_sample(vehicle), plans.current_position(vehicle)
    _write_partial(vehicle, 2, 3)
    if works:
        items[2:4] = [plans.waypoint(place, -50.0 * seq, 0) for seq in (2, 3)]
        return _answer_partial(vehicle, items, range(2, 4))
    answers = [e.kind for e in vehicle.wait(1.5) if e.kind in (*REQUESTS, "MISSION_ACK")]
    equal(answers, [], "answers")
    return "no answer"


@_ardupilot_check("mission.partial", source="AUTOPILOTS 2: may append at start=count")
def appends(vehicle: VehicleUnderTest) -> None:
    """A partial write that begins directly after the last item appends an item."""
    items, place = plans.store_sample(vehicle), plans.current_position(vehicle)
    seq = len(items)
    _write_partial(vehicle, seq, seq)
    items.append(plans.waypoint(place, -90, 0))
    _answer_partial(vehicle, items, range(seq, seq + 1))


@_ardupilot_check("mission.partial", source="AUTOPILOTS 2: bad range ERROR(1)")
def bad_range(vehicle: VehicleUnderTest) -> str:
    """A partial write that would leave a gap after the last item is answered ERROR."""
    n_items = len(plans.store_sample(vehicle))
    _write_partial(vehicle, n_items + 5, n_items + 6)
    return equal(plans.next_result(vehicle), "ERROR", "partial write")
