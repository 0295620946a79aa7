"""Mission upload, download and clearing."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import equal, holds, mission_result_name, near
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour
from sim_vehicle.station.frames import STATION
from sim_vehicle.station.plan_items import MISSION

N_MANY_ITEMS = 100


# -- upload ----------------------------------------------------------------------------------------------


@check("mission.upload.is_accepted", limit_s=200)
def is_accepted(vehicle: VehicleUnderTest) -> str:
    """A small mission is accepted."""
    done = plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    return f"{len(done.requests)} requests in {done.took_s:.2f} s"


@check("mission.upload.asks_in_order")
def requests_in_order(vehicle: VehicleUnderTest) -> str:
    """The vehicle requests the items in order, from 0."""
    items = plans.sample_plan(vehicle)
    seen = [seq for _, seq in plans.upload_or_fail(vehicle, items).requests]
    # On a lossy link the vehicle repeats requests, but never out of order.
    equal(sorted(set(seen)), list(range(len(items))), "requested items")
    equal(seen, sorted(seen), "order")
    return f"0 to {len(items) - 1}"


@check("mission.upload.kind_of_request", source="AUTOPILOTS 2: requests")
def kind_of_request(vehicle: VehicleUnderTest) -> str:
    """ArduPilot requests items with MISSION_REQUEST, PX4 with MISSION_REQUEST_INT after its first request."""
    later = known_behaviour(vehicle, ardupilot="MISSION_REQUEST", px4="MISSION_REQUEST_INT")
    kinds = [kind for kind, _ in plans.upload_or_fail(vehicle, plans.sample_plan(vehicle)).requests]
    holds(kinds[0] in ("MISSION_REQUEST", later), f"the first request is {kinds[0]}")
    equal(set(kinds[1:]), {later}, "the later requests")
    return f"{kinds[0]}, then {later}"


@check("mission.upload.ack_is_addressed")
def ack_is_addressed(vehicle: VehicleUnderTest) -> str:
    """The acknowledgement has the station's system id and the mission type."""
    ack = plans.upload_or_fail(vehicle, plans.sample_plan(vehicle)).ack
    equal((ack.target_system, ack.mission_type), (STATION[0], MISSION), "target and mission_type")
    return f"to {ack.target_system}"


@check("mission.upload.legacy_items", source="AUTOPILOTS 2: legacy float items also taken")
def legacy_items(vehicle: VehicleUnderTest) -> str:
    """An upload with MISSION_ITEM (floats) is accepted, and read back within 3 m."""
    items = plans.sample_plan(vehicle)
    done = plans.upload(vehicle, items, as_float=True)
    equal(mission_result_name(done.result), "ACCEPTED", "upload")
    for seen, sent in zip(plans.download(vehicle)[1:], items[1:], strict=True):
        off_m = plans.distance_m((seen.x, seen.y), (sent.x, sent.y))
        holds(off_m < 3, f"item {seen.seq}: expected less than 3 m off, saw {off_m:.1f} m")
    return "ACCEPTED"


@check("mission.upload.one_item")
def one_item(vehicle: VehicleUnderTest) -> str:
    """A mission of one take-off is accepted, and the vehicle reports its item count."""
    items = plans.plan(vehicle, plans.takeoff(plans.current_position(vehicle)))
    plans.upload_or_fail(vehicle, items)
    equal(plans.count(vehicle), len(items), "items")
    return f"{len(items)} items"


@check("mission.upload.many_items", limit_s=180)
def many_items(vehicle: VehicleUnderTest) -> str:
    """A mission of 100 items is accepted, and its commands and positions are read back exactly."""
    items = plans.sample_plan(vehicle, N_MANY_ITEMS, 30.0)
    done = plans.upload_or_fail(vehicle, items)
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return f"{len(items)} items in {done.took_s:.2f} s"


@check("mission.upload.replaces")
def replaces(vehicle: VehicleUnderTest) -> str:
    """A shorter mission replaces a longer mission."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle, 8))
    items = plans.sample_plan(vehicle, 3)
    plans.upload_or_fail(vehicle, items)
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return f"{len(items)} items"


@check("mission.upload.no_items")
def zero_items(vehicle: VehicleUnderTest) -> str:
    """MISSION_COUNT 0 is accepted and leaves at most home."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    done = plans.upload_or_fail(vehicle, [])
    equal(done.requests, (), "requests")
    n_items = plans.count(vehicle)
    holds(n_items <= int(vehicle.dialect.home_item), f"{n_items} items are stored")
    return "ACCEPTED"


@check("mission.upload.is_announced_twice")
def announced_twice(vehicle: VehicleUnderTest) -> str:
    """A repeated MISSION_COUNT, as after a lost request, does not disturb the upload."""
    items = plans.sample_plan(vehicle)
    vehicle.send(plans.count_message(vehicle, len(items)))
    vehicle.wait(0.1)
    equal(mission_result_name(plans.upload(vehicle, items).result), "ACCEPTED", "upload")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return "ACCEPTED"


# -- download --------------------------------------------------------------------------------------------


@check("mission.download.counts_what_was_sent", source="AUTOPILOTS 2: count")
def counts(vehicle: VehicleUnderTest) -> str:
    """MISSION_COUNT is the number of uploaded items (ArduPilot: with home)."""
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    equal(plans.count(vehicle), len(items), "MISSION_COUNT")
    return str(len(items))


@check("mission.download.places_are_exact")
def places_are_exact(vehicle: VehicleUnderTest) -> str:
    """Commands, latitudes and longitudes are read back exactly, altitudes to the centimetre."""
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    back = plans.download(vehicle)
    equal(plans.coordinates(vehicle, back), plans.coordinates(vehicle, items), "items")
    for seen, sent in zip(back[1:], items[1:], strict=True):
        near(seen.z, sent.z, 0.011, f"z of item {seen.seq}")
    return f"{len(back)} items"


@check("mission.download.is_numbered")
def is_numbered(vehicle: VehicleUnderTest) -> str:
    """Each item has its sequence number, the mission type and the station's system id."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    back = plans.download(vehicle)
    equal([item.seq for item in back], list(range(len(back))), "seq")
    equal(
        {(item.target_system, item.mission_type) for item in back}, {(STATION[0], MISSION)}, "target and type"
    )
    return f"0 to {len(back) - 1}"


@check("mission.download.legacy_request")
def legacy_request(vehicle: VehicleUnderTest) -> str:
    """MISSION_REQUEST is answered by MISSION_ITEM (floats), within 3 m of the uploaded position."""
    known_behaviour(vehicle, ardupilot=True, px4=True)
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    for seen, sent in zip(plans.download(vehicle, as_float=True)[1:], items[1:], strict=True):
        away_m = plans.distance_m((round(seen.x * 1e7), round(seen.y * 1e7)), (sent.x, sent.y))
        holds(away_m < 3, f"item {seen.seq}: expected less than 3 m off, saw {away_m:.1f} m")
    return "MISSION_ITEM"


@check("mission.download.same_twice")
def same_twice(vehicle: VehicleUnderTest) -> str:
    """Two downloads give the same items, apart from item 0."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    first, second = ([item.to_dict() for item in plans.download(vehicle)[1:]] for _ in range(2))
    equal(second, first, "items")
    return f"{len(first) + 1} items"


@check("mission.download.item_asked_twice")
def item_requested_again(vehicle: VehicleUnderTest) -> str:
    """The vehicle sends an item at each request."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    plans.open_list(vehicle)
    ask = mavlink.MAVLink_mission_request_int_message(*vehicle.target, 0, MISSION)
    for _ in range(3):
        vehicle.ask(ask, "MISSION_ITEM_INT", lambda m: m.seq == 0)
    plans.end_download(vehicle)
    return "3 times"


@check("mission.download.by_second_station")
def by_second_station(vehicle: VehicleUnderTest) -> str:
    """A second station reads the same mission."""
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    back = plans.download(vehicle, source=SECOND_STATION)
    equal(plans.coordinates(vehicle, back), plans.coordinates(vehicle, items), "items")
    return f"{len(back)} items"


@check("mission.download.item_zero", source="AUTOPILOTS 2: item 0 is home")
def item_zero(vehicle: VehicleUnderTest) -> str:
    """Item 0 is home on ArduPilot, even after the upload of another item 0, and an ordinary item on PX4."""
    is_home = known_behaviour(vehicle, ardupilot=True, px4=False)
    place = plans.current_position(vehicle)
    sent = plans.waypoint(place, 500, 500, 33.0)
    rest = (plans.takeoff(place), plans.waypoint(place, 30, 0))
    plans.upload_or_fail(vehicle, [sent, *rest])
    first = plans.download(vehicle)[0]
    if is_home:
        home = vehicle.request("HOME_POSITION")
        away_m = plans.distance_m((first.x, first.y), (home.latitude, home.longitude))
        holds(away_m < 1, f"expected home, saw a position {away_m:.0f} m from home")
    else:
        equal((first.x, first.y), (sent.x, sent.y), "item 0")
    return "home" if is_home else "as sent"


@check("mission.download.beyond_the_end")
def beyond_the_end(vehicle: VehicleUnderTest) -> str:
    """A request for a missing item is refused with an acknowledgement."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    total, mark = plans.open_list(vehicle), vehicle.mark()
    vehicle.send(mavlink.MAVLink_mission_request_int_message(*vehicle.target, total + 5, MISSION))
    ack = vehicle.expect("MISSION_ACK", plans.for_station(MISSION), mark=mark)
    plans.end_download(vehicle)
    holds(ack.type != mavlink.MAV_MISSION_ACCEPTED, "expected a refusal, saw ACCEPTED")
    equal(vehicle.since(mark, "MISSION_ITEM_INT"), [], "MISSION_ITEM_INT")
    return mission_result_name(ack.type)


@check("mission.download.another_vehicles")
def ignores_list_for_other_system(vehicle: VehicleUnderTest) -> str:
    """The vehicle does not answer a mission request to another system."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    plans.count(vehicle)  # confirms that the vehicle answers
    mark = vehicle.mark()
    vehicle.send(
        mavlink.MAVLink_mission_request_list_message(
            vehicle.unused_sysid(), vehicle.identity.component, MISSION
        )
    )
    vehicle.expect_none("MISSION_COUNT", during_s=1.5, mark=mark)
    return "no answer"


# -- clearing --------------------------------------------------------------------------------------------


@check("mission.clear.empties")
def empties(vehicle: VehicleUnderTest) -> str:
    """MISSION_CLEAR_ALL is accepted and leaves at most home."""
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    equal(mission_result_name(plans.clear(vehicle)), "ACCEPTED", "MISSION_CLEAR_ALL")
    n_items = plans.count(vehicle)
    holds(n_items <= int(vehicle.dialect.home_item), f"{n_items} items are stored")
    return f"{n_items} items stored"


@check("mission.clear.when_empty")
def when_empty(vehicle: VehicleUnderTest) -> str:
    """The vehicle accepts the clearing of an empty mission."""
    for _ in range(2):
        equal(mission_result_name(plans.clear(vehicle)), "ACCEPTED", "MISSION_CLEAR_ALL")
    return "ACCEPTED"


@check("mission.clear.all_types", source="AUTOPILOTS 2: types 2 / 3 / 255")
def clear_all_types(vehicle: VehicleUnderTest) -> str:
    """MISSION_CLEAR_ALL of type 255 clears the mission on PX4, and is UNSUPPORTED on ArduPilot."""
    clears = known_behaviour(vehicle, ardupilot=False, px4=True)
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    message = plans.clear_message(vehicle, mavlink.MAV_MISSION_TYPE_ALL)
    ack = vehicle.ask(message, "MISSION_ACK")
    equal(mission_result_name(ack.type), "ACCEPTED" if clears else "UNSUPPORTED", "MISSION_CLEAR_ALL of 255")
    equal(plans.count(vehicle), 0 if clears else len(items), "stored items")
    return mission_result_name(ack.type)


@check(
    "mission.target.other_component",
    source="AUTOPILOTS 1.15: mission requests to comp 0, 77 or 190 are executed",
)
def other_component(vehicle: VehicleUnderTest) -> str:
    """A mission request to component 77 is answered by ArduPilot and ignored by PX4."""
    executes = known_behaviour(vehicle, ardupilot=True, px4=False)
    plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))
    mark = vehicle.mark()
    vehicle.send(mavlink.MAVLink_mission_request_list_message(vehicle.identity.sysid, 77, MISSION))
    equal(vehicle.wait_for("MISSION_COUNT", mark=mark) is not None, executes, "answered")
    plans.end_download(vehicle)
    return "answered" if executes else "ignored"


@check("mission.type.plan_of_no_kind", source="AUTOPILOTS 2: types 2 / 3 / 255")
def plan_of_type_3(vehicle: VehicleUnderTest) -> str:
    """A list request of type 3 is UNSUPPORTED on ArduPilot, and has count 0 on PX4."""
    known_behaviour(vehicle, ardupilot=True, px4=True)
    mark = vehicle.mark()
    vehicle.send(plans.request_list(vehicle, 3))
    if vehicle.dialect.name == "ardupilot":
        ack = vehicle.expect("MISSION_ACK", mark=mark)
        equal(mission_result_name(ack.type), "UNSUPPORTED", "type 3")
        return "UNSUPPORTED"
    equal(vehicle.expect("MISSION_COUNT", mark=mark).count, 0, "count")
    plans.end_download(vehicle, 3)
    return "count 0"
