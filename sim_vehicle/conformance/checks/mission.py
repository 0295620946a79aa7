"""Mission upload, download, clearing, and the current item."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.peer import SECOND_STATION, STATION, Peer, known
from sim_vehicle.conformance.plans import MISSION
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, holds, mission_result_name, near

MANY = 100


# -- upload ----------------------------------------------------------------------------------------------


@check("mission.upload.is_accepted", limit_s=200)
def is_accepted(peer: Peer) -> str:
    """A small mission is accepted."""
    done = plans.put(peer, plans.sample_plan(peer))
    return f"{len(done.requests)} items in {done.took_s:.2f} s"


@check("mission.upload.asks_in_order")
def asks_in_order(peer: Peer) -> str:
    """Each item is asked for once, from 0 on."""
    items = plans.sample_plan(peer)
    seen = [seq for _, seq in plans.put(peer, items).requests]
    # A link that loses makes the vehicle ask again, never out of order.
    equal(sorted(set(seen)), list(range(len(items))), "asked for")
    equal(seen, sorted(seen), "order")
    return f"0 to {len(items) - 1}"


@check("mission.upload.kind_of_request", pins="AUTOPILOTS 2: requests")
def kind_of_request(peer: Peer) -> str:
    """ArduPilot asks with MISSION_REQUEST throughout, PX4 only until it has seen an integer item."""
    later = known(peer, ardupilot="MISSION_REQUEST", px4="MISSION_REQUEST_INT")
    kinds = [kind for kind, _ in plans.put(peer, plans.sample_plan(peer)).requests]
    holds(kinds[0] in ("MISSION_REQUEST", later), f"the first request is {kinds[0]}")
    equal(set(kinds[1:]), {later}, "the others")
    return f"{kinds[0]}, then {later}"


@check("mission.upload.ack_is_addressed")
def ack_is_addressed(peer: Peer) -> str:
    """The acknowledgement names the station and the type."""
    ack = plans.put(peer, plans.sample_plan(peer)).ack
    equal((ack.target_system, ack.mission_type), (STATION[0], MISSION), "target and mission_type")
    return f"to {ack.target_system}"


@check("mission.upload.legacy_items", pins="AUTOPILOTS 2: legacy float items also taken")
def legacy_items(peer: Peer) -> str:
    """MISSION_ITEM with floats is taken where MISSION_REQUEST was asked, to a few metres."""
    items = plans.sample_plan(peer)
    done = plans.upload(peer, items, as_float=True)
    equal(mission_result_name(done.result), "ACCEPTED", "upload")
    for seen, sent in zip(plans.download(peer)[1:], items[1:], strict=True):
        holds(plans.distance_m((seen.x, seen.y), (sent.x, sent.y)) < 3, f"item {seen.seq} is elsewhere")
    return "ACCEPTED"


@check("mission.upload.one_item")
def one_item(peer: Peer) -> str:
    """A mission of one take-off is accepted and read back."""
    items = plans.plan(peer, plans.takeoff(plans.here(peer)))
    plans.put(peer, items)
    equal(plans.count(peer), len(items), "items")
    return f"{len(items)} items"


@check("mission.upload.many_items", limit_s=180)
def many_items(peer: Peer) -> str:
    """A hundred items go up and come down equal."""
    items = plans.sample_plan(peer, MANY, 30.0)
    done = plans.put(peer, items)
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return f"{len(items)} up in {done.took_s:.2f} s"


@check("mission.upload.replaces")
def replaces(peer: Peer) -> str:
    """A shorter mission takes the place of a longer one."""
    plans.put(peer, plans.sample_plan(peer, 8))
    items = plans.sample_plan(peer, 3)
    plans.put(peer, items)
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return f"{len(items)} items left"


@check("mission.upload.none_at_all")
def none_at_all(peer: Peer) -> str:
    """MISSION_COUNT 0 is accepted and empties the mission."""
    plans.put(peer, plans.sample_plan(peer))
    done = plans.put(peer, [])
    equal(done.requests, (), "requests")
    holds(plans.count(peer) <= int(peer.dialect.home_item), "items are left")
    return "ACCEPTED"


@check("mission.upload.is_announced_twice")
def announced_twice(peer: Peer) -> str:
    """The same announcement again, as after a lost request, starts or goes on without harm."""
    items = plans.sample_plan(peer)
    peer.send(plans.count_message(peer, len(items)))
    peer.wait(0.1)
    equal(mission_result_name(plans.upload(peer, items).result), "ACCEPTED", "upload")
    equal(plans.body(peer, plans.download(peer)), plans.body(peer, items), "items")
    return "ACCEPTED"


# -- download --------------------------------------------------------------------------------------------


@check("mission.download.counts_what_was_sent", pins="AUTOPILOTS 2: count")
def counts(peer: Peer) -> str:
    """MISSION_COUNT is the number of items that were uploaded (ArduPilot: with home)."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    equal(plans.count(peer), len(items), "MISSION_COUNT")
    return str(len(items))


@check("mission.download.places_are_exact")
def places_are_exact(peer: Peer) -> str:
    """Commands, latitudes and longitudes come back to the last digit, altitudes to the centimetre."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    back = plans.download(peer)
    equal(plans.body(peer, back), plans.body(peer, items), "items")
    for seen, sent in zip(back[1:], items[1:], strict=True):
        near(seen.z, sent.z, 0.011, f"z of item {seen.seq}")
    return f"{len(back)} items"


@check("mission.download.is_numbered")
def is_numbered(peer: Peer) -> str:
    """Each item carries the number it was asked by, the type and our address."""
    plans.put(peer, plans.sample_plan(peer))
    back = plans.download(peer)
    equal([item.seq for item in back], list(range(len(back))), "seq")
    equal(
        {(item.target_system, item.mission_type) for item in back}, {(STATION[0], MISSION)}, "target and type"
    )
    return f"0 to {len(back) - 1}"


@check("mission.download.legacy_request")
def legacy_request(peer: Peer) -> str:
    """MISSION_REQUEST is answered by MISSION_ITEM with floats."""
    known(peer, ardupilot=True, px4=True)
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    for seen, sent in zip(plans.download(peer, as_float=True)[1:], items[1:], strict=True):
        away_m = plans.distance_m((round(seen.x * 1e7), round(seen.y * 1e7)), (sent.x, sent.y))
        holds(away_m < 3, f"item {seen.seq} is {away_m:.1f} m off")
    return "MISSION_ITEM"


@check("mission.download.same_twice")
def same_twice(peer: Peer) -> str:
    """Two downloads are equal, altitudes of home aside."""
    plans.put(peer, plans.sample_plan(peer))
    first, second = ([item.to_dict() for item in plans.download(peer)[1:]] for _ in range(2))
    equal(second, first, "items")
    return f"{len(first) + 1} items"


@check("mission.download.item_asked_twice")
def item_asked_twice(peer: Peer) -> str:
    """An item is sent as often as it is asked for."""
    plans.put(peer, plans.sample_plan(peer))
    plans.open_list(peer)
    ask = mavlink.MAVLink_mission_request_int_message(*peer.target, 0, MISSION)
    for _ in range(3):
        peer.ask(ask, "MISSION_ITEM_INT", lambda m: m.seq == 0)
    plans.finish(peer)
    return "3 times"


@check("mission.download.by_second_station")
def by_second_station(peer: Peer) -> str:
    """Another station reads the same mission."""
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    back = plans.download(peer, source=SECOND_STATION)
    equal(plans.body(peer, back), plans.body(peer, items), "items")
    return f"{len(back)} items"


@check("mission.download.item_zero", pins="AUTOPILOTS 2: item 0 is home")
def item_zero(peer: Peer) -> str:
    """Item 0 is home for ArduPilot whatever was sent, an ordinary item for PX4."""
    is_home = known(peer, ardupilot=True, px4=False)
    place = plans.here(peer)
    sent = plans.waypoint(place, 500, 500, 33.0)
    rest = (plans.takeoff(place), plans.waypoint(place, 30, 0))
    plans.put(peer, [sent, *rest])
    first = plans.download(peer)[0]
    if is_home:
        home = peer.request("HOME_POSITION")
        away_m = plans.distance_m((first.x, first.y), (home.latitude, home.longitude))
        holds(away_m < 1, f"expected home, saw a place {away_m:.0f} m from it")
    else:
        equal((first.x, first.y), (sent.x, sent.y), "item 0")
    return "home" if is_home else "as it was sent"


@check("mission.download.behind_the_end", pins="AUTOPILOTS 2: wrong item")
def behind_the_end(peer: Peer) -> str:
    """An item that is not there is refused with an acknowledgement."""
    plans.put(peer, plans.sample_plan(peer))
    total, mark = plans.open_list(peer), peer.mark()
    peer.send(mavlink.MAVLink_mission_request_int_message(*peer.target, total + 5, MISSION))
    ack = peer.expect("MISSION_ACK", plans.for_us(MISSION), mark=mark)
    plans.finish(peer)
    holds(ack.type != mavlink.MAV_MISSION_ACCEPTED, "expected a refusal, saw ACCEPTED")
    equal(peer.since(mark, "MISSION_ITEM_INT"), [], "MISSION_ITEM_INT")
    return mission_result_name(ack.type)


@check("mission.download.another_vehicles")
def download_anothers(peer: Peer) -> str:
    """A mission that another system is asked for is not sent."""
    plans.put(peer, plans.sample_plan(peer))
    plans.count(peer)  # it does answer
    mark = peer.mark()
    peer.send(mavlink.MAVLink_mission_request_list_message(peer.stranger(), peer.facts.component, MISSION))
    peer.none("MISSION_COUNT", during_s=1.5, mark=mark)
    return "no answer"


# -- clearing --------------------------------------------------------------------------------------------


@check("mission.clear.empties")
def empties(peer: Peer) -> str:
    """MISSION_CLEAR_ALL is accepted, and nothing but home is left."""
    plans.put(peer, plans.sample_plan(peer))
    equal(mission_result_name(plans.clear(peer)), "ACCEPTED", "MISSION_CLEAR_ALL")
    left = plans.count(peer)
    holds(left <= int(peer.dialect.home_item), f"{left} items are left")
    return f"{left} items left"


@check("mission.clear.when_empty")
def when_empty(peer: Peer) -> str:
    """Clearing twice is accepted twice."""
    for _ in range(2):
        equal(mission_result_name(plans.clear(peer)), "ACCEPTED", "MISSION_CLEAR_ALL")
    return "ACCEPTED"


@check("mission.clear.all_types", pins="AUTOPILOTS 2: types 2 / 3 / 255")
def clear_all_types(peer: Peer) -> str:
    """Type 255 clears everything for PX4, and is UNSUPPORTED and clears nothing for ArduPilot."""
    clears = known(peer, ardupilot=False, px4=True)
    items = plans.sample_plan(peer)
    plans.put(peer, items)
    message = plans.clear_message(peer, mavlink.MAV_MISSION_TYPE_ALL)
    ack = peer.ask(message, "MISSION_ACK")
    equal(mission_result_name(ack.type), "ACCEPTED" if clears else "UNSUPPORTED", "MISSION_CLEAR_ALL of 255")
    equal(plans.count(peer), 0 if clears else len(items), "items left")
    return mission_result_name(ack.type)


@check(
    "mission.target.other_component",
    pins="AUTOPILOTS 1.15: mission requests to comp 0, 77 or 190 are executed",
)
def other_component(peer: Peer) -> str:
    """A mission request to component 77 is answered by ArduPilot, and by nobody else."""
    obeys = known(peer, ardupilot=True, px4=False)
    plans.put(peer, plans.sample_plan(peer))
    mark = peer.mark()
    peer.send(mavlink.MAVLink_mission_request_list_message(peer.facts.sysid, 77, MISSION))
    equal(peer.maybe("MISSION_COUNT", mark=mark) is not None, obeys, "answered")
    plans.finish(peer)
    return "answered" if obeys else "ignored"


@check("mission.type.plan_of_no_kind", pins="AUTOPILOTS 2: types 2 / 3 / 255")
def plan_of_no_kind(peer: Peer) -> str:
    """A list of type 3 is UNSUPPORTED for ArduPilot, empty for PX4."""
    known(peer, ardupilot=True, px4=True)
    mark = peer.mark()
    peer.send(plans.request_list(peer, 3))
    if peer.dialect.name == "ardupilot":
        ack = peer.expect("MISSION_ACK", mark=mark)
        equal(mission_result_name(ack.type), "UNSUPPORTED", "type 3")
        return "UNSUPPORTED"
    equal(peer.expect("MISSION_COUNT", mark=mark).count, 0, "count")
    plans.finish(peer, 3)
    return "count 0"
