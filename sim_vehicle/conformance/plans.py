"""Missions, fences and rally points: items, upload and download by the mission protocol."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import equal
from sim_vehicle.conformance.guard import PLAN_NAMES
from sim_vehicle.conformance.outcomes import ACCEPTED, CheckFailed, Skip, mission_result_name
from sim_vehicle.conformance.traffic import Condition
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.exchanges import REQUESTS, UploadPlan
from sim_vehicle.station.frames import STATION, ReceivedFrame, Source
from sim_vehicle.station.messages import MISSION, PlanItem

FENCE = int(mavlink.MAV_MISSION_TYPE_FENCE)
RALLY = int(mavlink.MAV_MISSION_TYPE_RALLY)
ALL = int(mavlink.MAV_MISSION_TYPE_ALL)
CAPABILITIES = {MISSION: None, FENCE: "MISSION_FENCE", RALLY: "MISSION_RALLY"}  # claimed by a vehicle
M_PER_DEG = 111_319.5
POSITION_S = 120.0  # longest wait for a position
BACKUP_ATTEMPTS = 3  # in each attempt every item is requested up to three times
TRANSFER_ENDS_S = 6.0  # wait between attempts; PX4 ends a broken transfer after 5 s
REQUEST_S = 3.0  # longest wait for the next request of an upload
UPLOAD_ATTEMPTS = 8  # transmissions of MISSION_COUNT without a request, in 12 s


@dataclass(frozen=True, slots=True)
class UploadResult:
    """The outcome of an acknowledged upload."""

    result: str  # name of the MAV_MISSION_RESULT
    requests: tuple[tuple[str, int], ...]  # (name of the message, seq)
    ack: Any  # MISSION_ACK
    took_s: float


# -- positions -------------------------------------------------------------------------------------------


def current_position(vehicle: VehicleUnderTest) -> tuple[int, int]:
    """Wait for a position other than 0, 0; return latitude and longitude [1e-7 deg]."""
    end_s = vehicle.now + POSITION_S
    while vehicle.now < end_s:
        found = vehicle.request("GLOBAL_POSITION_INT")
        if found.lat or found.lon:
            return found.lat, found.lon
        vehicle.wait(1.0)
    raise CheckFailed(f"expected a position within {POSITION_S:g} s, saw 0, 0")


def offset(place: tuple[int, int], north_m: float, east_m: float) -> tuple[int, int]:
    """Return a position [1e-7 deg] that lies `north_m` and `east_m` from `place`."""
    lat, lon = place
    per_deg = M_PER_DEG * math.cos(math.radians(lat / 1e7))
    return lat + round(north_m / M_PER_DEG * 1e7), lon + round(east_m / per_deg * 1e7)


def distance_m(a: tuple[int, int], b: tuple[int, int]) -> float:
    per_deg = M_PER_DEG * math.cos(math.radians(a[0] / 1e7))
    return math.hypot((a[0] - b[0]) / 1e7 * M_PER_DEG, (a[1] - b[1]) / 1e7 * per_deg)


def waypoint(
    place: tuple[int, int], north_m: float, east_m: float, z: float = 20.0, **changes: Any
) -> PlanItem:
    x, y = offset(place, north_m, east_m)
    return replace(PlanItem(mavlink.MAV_CMD_NAV_WAYPOINT, x, y, z), **changes)


def takeoff(place: tuple[int, int], z: float = 20.0) -> PlanItem:
    return PlanItem(mavlink.MAV_CMD_NAV_TAKEOFF, *place, z)


def land(place: tuple[int, int], north_m: float = 0.0, east_m: float = 0.0) -> PlanItem:
    x, y = offset(place, north_m, east_m)
    return PlanItem(mavlink.MAV_CMD_NAV_LAND, x, y)


def plan(vehicle: VehicleUnderTest, *items: PlanItem) -> list[PlanItem]:
    """Return the items; for ArduPilot, add a placeholder of home as item 0."""
    if not vehicle.dialect.home_item:
        return list(items)
    return [
        PlanItem(mavlink.MAV_CMD_NAV_WAYPOINT, *current_position(vehicle), frame=mavlink.MAV_FRAME_GLOBAL),
        *items,
    ]


def sample_plan(vehicle: VehicleUnderTest, count: int = 5, z: float = 20.0) -> list[PlanItem]:
    """Return a take-off and waypoints: `count` items, not counting a home placeholder."""
    place = current_position(vehicle)
    points = [waypoint(place, 30.0 * i, 20.0 * (i % 3), z + i) for i in range(1, count)]
    return plan(vehicle, takeoff(place, z), *points)


def store_sample(vehicle: VehicleUnderTest, count: int = 5) -> list[PlanItem]:
    """Upload the mission of `sample_plan`; return its items."""
    items = sample_plan(vehicle, count)
    upload_or_fail(vehicle, items)
    return items


# -- messages --------------------------------------------------------------------------------------------


def count_message(vehicle: VehicleUnderTest, count: int, kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_count_message(*vehicle.target, count, kind)


def request_list(vehicle: VehicleUnderTest, kind: int = MISSION) -> Any:
    return mavlink.MAVLink_mission_request_list_message(*vehicle.target, kind)


def clear_message(vehicle: VehicleUnderTest, kind: int) -> Any:
    return mavlink.MAVLink_mission_clear_all_message(*vehicle.target, kind)


def send_item(vehicle: VehicleUnderTest, items: Sequence[PlanItem], seq: int, kind: int = MISSION) -> None:
    vehicle.send(items[seq].message(vehicle.target, seq, kind))


def for_station(kind: int, source: Source = STATION, seq: int | None = None) -> Condition:
    """Return the condition for messages of this plan type, and item, to this station or to all systems."""

    def fits(message: Any) -> bool:
        addressed = message.mission_type == kind and message.target_system in (0, source[0])
        return bool(addressed and (seq is None or message.seq == seq))

    return fits


def next_request(vehicle: VehicleUnderTest) -> int:
    """Return the seq of the next MISSION_REQUEST(_INT); raise CheckFailed if none arrives."""
    index = vehicle.seek(REQUESTS, for_station(MISSION), within_s=REQUEST_S, mark=None)
    if index is None:
        raise CheckFailed(f"expected a request for an item within {REQUEST_S:g} s, saw none")
    return int(vehicle.received[index].message.seq)


def next_step(vehicle: VehicleUnderTest, mark: int | None = None) -> tuple[ReceivedFrame, int]:
    """Return the next request or MISSION_ACK of an upload after a mark, and the mark after it."""
    index = vehicle.seek((*REQUESTS, "MISSION_ACK"), within_s=REQUEST_S, mark=mark)
    if index is None:
        raise CheckFailed(f"the vehicle neither requested nor acknowledged within {REQUEST_S:g} s")
    return vehicle.received[index], index + 1


# -- transfers -------------------------------------------------------------------------------------------


def upload(
    vehicle: VehicleUnderTest, items: Sequence[PlanItem], kind: int = MISSION, *, as_float: bool = False
) -> UploadResult:
    """Upload a plan; return the outcome, even of a refusal. Raise CheckFailed without MISSION_ACK."""
    began_s = vehicle.now
    exchange = UploadPlan(
        vehicle.send, vehicle.target, items, kind, as_float=as_float, attempts=UPLOAD_ATTEMPTS
    )
    outcome = vehicle.complete(exchange)
    if outcome.message is None:
        raise CheckFailed(f"upload: {outcome.text} after {len(exchange.requests)} requests")
    return UploadResult(outcome.text, tuple(exchange.requests), outcome.message, vehicle.now - began_s)


def upload_or_fail(vehicle: VehicleUnderTest, items: Sequence[PlanItem], kind: int = MISSION) -> UploadResult:
    """Upload a plan; raise CheckFailed unless the vehicle accepts the plan."""
    done = upload(vehicle, items, kind)
    equal(done.result, ACCEPTED, f"upload of {len(items)} items")
    return done


def end_download(vehicle: VehicleUnderTest, kind: int = MISSION, source: Source = STATION) -> None:
    """Acknowledge a download; PX4 accepts no upload before the acknowledgement or a time-out."""
    accepted = mavlink.MAV_MISSION_ACCEPTED
    vehicle.send(mavlink.MAVLink_mission_ack_message(*vehicle.target, accepted, kind), source)


def open_list(vehicle: VehicleUnderTest, kind: int = MISSION, source: Source = STATION) -> int:
    """Begin a download; return the number of items. `end_download` ends the download."""
    answer = vehicle.ask(
        request_list(vehicle, kind), "MISSION_COUNT", for_station(kind, source), source=source
    )
    return int(answer.count)


def count(vehicle: VehicleUnderTest, kind: int = MISSION) -> int:
    """Return the number of stored items."""
    found = open_list(vehicle, kind)
    end_download(vehicle, kind)
    return found


def download(
    vehicle: VehicleUnderTest, kind: int = MISSION, *, as_float: bool = False, source: Source = STATION
) -> list[Any]:
    """Download and acknowledge the stored items; return their messages."""
    request = (
        mavlink.MAVLink_mission_request_message if as_float else mavlink.MAVLink_mission_request_int_message
    )
    answer = "MISSION_ITEM" if as_float else "MISSION_ITEM_INT"
    items = [
        vehicle.ask(
            request(*vehicle.target, seq, kind), answer, for_station(kind, source, seq), source=source
        )
        for seq in range(open_list(vehicle, kind, source))
    ]
    end_download(vehicle, kind, source)
    return items


def clear(vehicle: VehicleUnderTest, kind: int = MISSION) -> str:
    """Send MISSION_CLEAR_ALL; return the name of the MAV_MISSION_RESULT."""
    ack = vehicle.ask(clear_message(vehicle, kind), "MISSION_ACK", for_station(kind))
    return mission_result_name(ack.type)


def coordinates(
    vehicle: VehicleUnderTest, items: Sequence[Any], kind: int = MISSION
) -> list[tuple[int, int, int]]:
    """Return (command, x, y) of sent or received items, without a home placeholder."""
    first = 1 if vehicle.dialect.home_item and kind == MISSION else 0
    return [(i.command, i.x, i.y) for i in items[first:]]


def expect_stored(
    vehicle: VehicleUnderTest, items: Sequence[PlanItem], kind: int = MISSION, *, source: Source = STATION
) -> list[Any]:
    """Download a plan; raise CheckFailed unless its commands and positions are those of `items`."""
    back = download(vehicle, kind, source=source)
    equal(coordinates(vehicle, back, kind), coordinates(vehicle, items, kind), PLAN_NAMES[kind])
    return back


def store(vehicle: VehicleUnderTest, items: Sequence[PlanItem], kind: int = MISSION) -> list[Any]:
    """Upload a plan; return the items read back, with the commands and positions as sent."""
    upload_or_fail(vehicle, items, kind)
    return expect_stored(vehicle, items, kind)


def next_result(vehicle: VehicleUnderTest, *, source: Source = STATION) -> str:
    """Return the name of the MAV_MISSION_RESULT in the next MISSION_ACK for a mission."""
    return mission_result_name(vehicle.expect("MISSION_ACK", for_station(MISSION, source)).type)


def cancel_upload(vehicle: VehicleUnderTest) -> None:
    """Cancel an upload and wait until the vehicle has ended the transfer."""
    cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
    vehicle.send(mavlink.MAVLink_mission_ack_message(*vehicle.target, cancelled, MISSION))
    # ArduPilot ignores the cancellation and ends the transfer by its time-out.
    vehicle.wait(1.0 if vehicle.dialect.name == "px4" else 10.0)


def begin_upload(vehicle: VehicleUnderTest, items: list[PlanItem], sent: int) -> None:
    """Begin an upload, and stop after `sent` items and the next, unanswered request."""
    vehicle.send(count_message(vehicle, len(items)))
    for _ in range(sent):
        send_item(vehicle, items, next_request(vehicle))
    next_request(vehicle)


class PlanBackup:
    """Copies of the plans on a vehicle before the checks; `Traffic` lets only copied plans be overwritten."""

    def __init__(self, vehicle: VehicleUnderTest) -> None:
        self._vehicle = vehicle
        self._copies: dict[int, list[PlanItem]] = {}
        self.unsaved: dict[int, str] = {}  # type of an unreadable plan -> reason
        self.is_taken = False

    def save(self) -> None:
        self.is_taken = True
        for kind, capability in CAPABILITIES.items():
            if capability is None or self._vehicle.identity.claims(capability):
                self._save(kind)
        if not self.unsaved:
            self._vehicle.saved_plans.add(ALL)

    def _save(self, kind: int) -> None:
        for attempt in range(BACKUP_ATTEMPTS):
            try:
                self._copies[kind] = [_item(message) for message in download(self._vehicle, kind)]
            except (CheckFailed, Skip) as error:
                self.unsaved[kind] = str(error)
                if attempt < BACKUP_ATTEMPTS - 1:
                    self._vehicle.wait(TRANSFER_ENDS_S)
            else:
                self.unsaved.pop(kind, None)
                self._vehicle.saved_plans.add(kind)
                return

    def restore(self) -> list[str]:
        """Restore the plans; return a text for each failure."""
        failures = []
        for kind, items in self._copies.items():
            try:
                upload_or_fail(self._vehicle, items, kind)
            except (CheckFailed, Skip) as error:
                failures.append(
                    f"the {PLAN_NAMES[kind]} could not be restored: {error}; "
                    "upload the plan again from a ground station [not-restored]"
                )
        return failures

    def names(self) -> list[str]:
        return [PLAN_NAMES[kind] for kind in self._copies]


def _item(message: Any) -> PlanItem:
    params = (message.param1, message.param2, message.param3, message.param4)
    return PlanItem(message.command, message.x, message.y, message.z, message.frame, params)
