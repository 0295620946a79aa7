"""Mission upload, download and clearing."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import at_most, equal, near, one_of, refused, within
from sim_vehicle.conformance.outcomes import ACCEPTED, mission_result_name
from sim_vehicle.conformance.registry import KNOWN, check
from sim_vehicle.conformance.traffic import SECOND_STATION
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.frames import STATION
from sim_vehicle.station.messages import MISSION

N_MANY_ITEMS = 100
AGREE_M = 3.0  # a position in floating point is within this distance


def _upload_sample(vehicle: VehicleUnderTest) -> plans.UploadResult:
    return plans.upload_or_fail(vehicle, plans.sample_plan(vehicle))


def _expect_empty(vehicle: VehicleUnderTest) -> int:
    """Return the number of items, at most home; raise CheckFailed if others are stored."""
    return int(within(plans.count(vehicle), 0, int(vehicle.dialect.home_item), "stored items"))


@check("mission.upload")
def is_accepted(vehicle: VehicleUnderTest) -> str:
    """A small mission is accepted."""
    done = _upload_sample(vehicle)
    return f"{len(done.requests)} requests in {done.took_s:.2f} s"


@check("mission.upload")
def asks_in_order(vehicle: VehicleUnderTest) -> None:
    """The vehicle requests the items in order, from 0."""
    items = plans.sample_plan(vehicle)
    seen = [seq for _, seq in plans.upload_or_fail(vehicle, items).requests]
    # On a lossy link the vehicle repeats requests, but never out of order.
    equal(sorted(set(seen)), list(range(len(items))), "requested items")
    equal(seen, sorted(seen), "order")


@check("mission.upload", source="AUTOPILOTS 2: requests")
def kind_of_request(vehicle: VehicleUnderTest) -> str:
    """ArduPilot requests items with MISSION_REQUEST, PX4 with MISSION_REQUEST_INT after its first request."""
    later = vehicle.known(ardupilot="MISSION_REQUEST", px4="MISSION_REQUEST_INT")
    first, *others = (kind for kind, _ in _upload_sample(vehicle).requests)
    one_of(first, ("MISSION_REQUEST", later), "the first request")
    equal(set(others), {later}, "the later requests")
    return f"{first}, then {later}"


@check("mission.upload")
def ack_is_addressed(vehicle: VehicleUnderTest) -> str:
    """The acknowledgement has the station's system id and the mission type."""
    ack = _upload_sample(vehicle).ack
    equal((ack.target_system, ack.mission_type), (STATION[0], MISSION), "target and mission_type")
    return f"to {ack.target_system}"


def _expect_near(items: list[Any], back: list[Any], degrees: float) -> None:
    """Compare the positions of items read back, in units of 1 / `degrees`, apart from item 0."""
    for seen, sent in zip(back[1:], items[1:], strict=True):
        off_m = plans.distance_m((round(seen.x * degrees), round(seen.y * degrees)), (sent.x, sent.y))
        at_most(off_m, AGREE_M, f"distance of item {seen.seq} [m]")


@check("mission.upload", source="AUTOPILOTS 2: legacy float items also taken")
def legacy_items(vehicle: VehicleUnderTest) -> str:
    """An upload with MISSION_ITEM (floats) is accepted, and read back within 3 m."""
    items = plans.sample_plan(vehicle)
    result = equal(plans.upload(vehicle, items, as_float=True).result, ACCEPTED, "upload")
    _expect_near(items, plans.download(vehicle), 1)
    return result


@check("mission.upload")
def one_item(vehicle: VehicleUnderTest) -> str:
    """A mission of one take-off is accepted, and the vehicle reports its item count."""
    items = plans.plan(vehicle, plans.takeoff(plans.current_position(vehicle)))
    plans.upload_or_fail(vehicle, items)
    return f"{equal(plans.count(vehicle), len(items), 'items')} items"


@check("mission.upload")
def many_items(vehicle: VehicleUnderTest) -> str:
    """A mission of 100 items is accepted, and its commands and positions are read back exactly."""
    items = plans.sample_plan(vehicle, N_MANY_ITEMS, 30.0)
    done = plans.upload_or_fail(vehicle, items)
    plans.expect_stored(vehicle, items)
    return f"{len(items)} items in {done.took_s:.2f} s"


@check("mission.upload")
def replaces(vehicle: VehicleUnderTest) -> str:
    """A shorter mission replaces a longer mission."""
    plans.store_sample(vehicle, 8)
    return f"{len(plans.store(vehicle, plans.sample_plan(vehicle, 3)))} items"


@check("mission.upload")
def no_items(vehicle: VehicleUnderTest) -> None:
    """MISSION_COUNT 0 is accepted and leaves at most home."""
    plans.store_sample(vehicle)
    done = plans.upload_or_fail(vehicle, [])
    equal(done.requests, (), "requests")
    _expect_empty(vehicle)


@check("mission.upload")
def is_announced_twice(vehicle: VehicleUnderTest) -> None:
    """A repeated MISSION_COUNT, as after a lost request, does not disturb the upload."""
    items = plans.sample_plan(vehicle)
    vehicle.send(plans.count_message(vehicle, len(items)))
    vehicle.wait(0.1)
    plans.store(vehicle, items)


@check("mission.download", source="AUTOPILOTS 2: count")
def counts_what_was_sent(vehicle: VehicleUnderTest) -> str:
    """MISSION_COUNT is the number of uploaded items (ArduPilot: with home)."""
    n_items = len(plans.store_sample(vehicle))
    return str(equal(plans.count(vehicle), n_items, "MISSION_COUNT"))


@check("mission.download")
def places_are_exact(vehicle: VehicleUnderTest) -> None:
    """Commands, latitudes and longitudes are read back exactly, altitudes to the centimetre."""
    items = plans.sample_plan(vehicle)
    back = plans.store(vehicle, items)
    for seen, sent in zip(back[1:], items[1:], strict=True):
        near(seen.z, sent.z, 0.011, f"z of item {seen.seq}")


@check("mission.download")
def is_numbered(vehicle: VehicleUnderTest) -> None:
    """Each item has its sequence number, the mission type and the station's system id."""
    plans.store_sample(vehicle)
    back = plans.download(vehicle)
    equal([item.seq for item in back], list(range(len(back))), "seq")
    addresses = {(item.target_system, item.mission_type) for item in back}
    equal(addresses, {(STATION[0], MISSION)}, "target and type")


@check("mission.download", dialects=KNOWN)
def legacy_request(vehicle: VehicleUnderTest) -> None:
    """MISSION_REQUEST is answered by MISSION_ITEM (floats), within 3 m of the uploaded position."""
    items = plans.store_sample(vehicle)
    _expect_near(items, plans.download(vehicle, as_float=True), 1e7)


@check("mission.download")
def same_twice(vehicle: VehicleUnderTest) -> str:
    """Two downloads give the same items, apart from item 0."""
    plans.store_sample(vehicle)
    first, second = ([item.to_dict() for item in plans.download(vehicle)[1:]] for _ in range(2))
    return f"{len(equal(second, first, 'items')) + 1} items"


@check("mission.download")
def item_asked_twice(vehicle: VehicleUnderTest) -> None:
    """The vehicle sends an item at each request."""
    plans.store_sample(vehicle)
    plans.open_list(vehicle)
    ask = mavlink.MAVLink_mission_request_int_message(*vehicle.target, 0, MISSION)
    for _ in range(3):
        vehicle.ask(ask, "MISSION_ITEM_INT", lambda m: m.seq == 0)
    plans.end_download(vehicle)


@check("mission.download")
def by_second_station(vehicle: VehicleUnderTest) -> str:
    """A second station reads the same mission."""
    items = plans.store_sample(vehicle)
    return f"{len(plans.expect_stored(vehicle, items, source=SECOND_STATION))} items"


@check("mission.download", source="AUTOPILOTS 2: item 0 is home")
def item_zero(vehicle: VehicleUnderTest) -> None:
    """Item 0 is home on ArduPilot, even after the upload of another item 0, and an ordinary item on PX4."""
    is_home = vehicle.known(ardupilot=True, px4=False)
    place = plans.current_position(vehicle)
    sent = plans.waypoint(place, 500, 500, 33.0)
    plans.upload_or_fail(vehicle, [sent, plans.takeoff(place), plans.waypoint(place, 30, 0)])
    first = plans.download(vehicle)[0]
    if not is_home:
        equal((first.x, first.y), (sent.x, sent.y), "item 0")
        return
    at_most(plans.distance_m((first.x, first.y), flying.home(vehicle)), 1, "distance from home [m]")


@check("mission.download")
def beyond_the_end(vehicle: VehicleUnderTest) -> str:
    """A request for a missing item is refused with an acknowledgement."""
    plans.store_sample(vehicle)
    beyond = plans.open_list(vehicle) + 5
    mark = vehicle.mark()
    vehicle.send(mavlink.MAVLink_mission_request_int_message(*vehicle.target, beyond, MISSION))
    result = plans.next_result(vehicle)
    plans.end_download(vehicle)
    equal(vehicle.since(mark, "MISSION_ITEM_INT"), [], "MISSION_ITEM_INT")
    return refused(result)


@check("mission.download")
def another_vehicles(vehicle: VehicleUnderTest) -> None:
    """The vehicle does not answer a mission request to another system."""
    plans.store_sample(vehicle)
    plans.count(vehicle)  # confirms that the vehicle answers
    target = vehicle.unused_sysid(), vehicle.identity.component
    vehicle.send(mavlink.MAVLink_mission_request_list_message(*target, MISSION))
    vehicle.expect_none("MISSION_COUNT", during_s=1.5)


@check("mission.clear")
def empties(vehicle: VehicleUnderTest) -> str:
    """MISSION_CLEAR_ALL is accepted and leaves at most home."""
    plans.store_sample(vehicle)
    equal(plans.clear(vehicle), ACCEPTED, "MISSION_CLEAR_ALL")
    return f"{_expect_empty(vehicle)} items stored"


@check("mission.clear")
def when_empty(vehicle: VehicleUnderTest) -> str:
    """The vehicle accepts the clearing of an empty mission."""
    plans.clear(vehicle)
    return equal(plans.clear(vehicle), ACCEPTED, "MISSION_CLEAR_ALL")


@check("mission.clear", source="AUTOPILOTS 2: types 2 / 3 / 255")
def all_types(vehicle: VehicleUnderTest) -> str:
    """MISSION_CLEAR_ALL of type 255 clears the mission on PX4, and is UNSUPPORTED on ArduPilot."""
    expected, clears = vehicle.known(ardupilot=("UNSUPPORTED", False), px4=(ACCEPTED, True))
    n_items = len(plans.store_sample(vehicle))
    ack = vehicle.ask(plans.clear_message(vehicle, mavlink.MAV_MISSION_TYPE_ALL), "MISSION_ACK")
    equal(plans.count(vehicle), 0 if clears else n_items, "stored items")
    return equal(mission_result_name(ack.type), expected, "MISSION_CLEAR_ALL of 255")


@check("mission.target", source="AUTOPILOTS 1.15: mission requests to comp 0, 77 or 190 are executed")
def other_component(vehicle: VehicleUnderTest) -> None:
    """A mission request to component 77 is answered by ArduPilot and ignored by PX4."""
    executes = vehicle.known(ardupilot=True, px4=False)
    plans.store_sample(vehicle)
    vehicle.send(mavlink.MAVLink_mission_request_list_message(vehicle.identity.sysid, 77, MISSION))
    equal(vehicle.wait_for("MISSION_COUNT") is not None, executes, "answered")
    plans.end_download(vehicle)


@check("mission.type", source="AUTOPILOTS 2: types 2 / 3 / 255")
def plan_of_no_kind(vehicle: VehicleUnderTest) -> str:
    """A list request of type 3 is UNSUPPORTED on ArduPilot, and has count 0 on PX4."""
    refuses = vehicle.known(ardupilot=True, px4=False)
    vehicle.send(plans.request_list(vehicle, 3))
    if refuses:
        return equal(mission_result_name(vehicle.expect("MISSION_ACK").type), "UNSUPPORTED", "type 3")
    equal(vehicle.expect("MISSION_COUNT").count, 0, "count")
    plans.end_download(vehicle, 3)
    return "count 0"
