"""The current item of a mission, and unusual items: their results, and what is read back."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import equal, near, one_of, refused, within
from sim_vehicle.conformance.outcomes import ACCEPTED
from sim_vehicle.conformance.registry import Row, check, checks, row
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.messages import PlanItem

CHECKED_S = 2.0  # longest time until PX4 has checked a new mission
NO_MISSION_TOTAL = 65_535
NO_SUCH_COMMAND = 31_900
SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
_ardupilot_check = partial(check, "mission.current", dialects=("ardupilot",))


def _current(vehicle: VehicleUnderTest) -> Any:
    return vehicle.request("MISSION_CURRENT")


def _is_item(seq: int, message: Any) -> bool:
    return bool(message.seq == seq)


@check("mission.current", source="AUTOPILOTS 2: MISSION_CURRENT.total does not include home")
def total(vehicle: VehicleUnderTest) -> str:
    """MISSION_CURRENT.total is the number of items without home; an unknown autopilot may report 0."""
    n_items = len(plans.store_sample(vehicle)) - int(vehicle.dialect.home_item)
    total = _current(vehicle).total
    if not vehicle.dialect.is_known and total == 0:
        return "not reported"
    return str(equal(total, n_items, "total"))


@check("mission.current", source="AUTOPILOTS 2: total 65535 with no mission")
def total_of_nothing(vehicle: VehicleUnderTest) -> str:
    """Without a mission, total is 65535 on PX4 and 0 or 65535 on ArduPilot."""
    allowed = vehicle.known(ardupilot={0, NO_MISSION_TOTAL}, px4={NO_MISSION_TOTAL})
    plans.clear(vehicle)
    vehicle.wait(1.0)
    return str(one_of(_current(vehicle).total, allowed, "total"))


@check("mission.current", source="AUTOPILOTS 2: mission_state is 0 always (PX4)")
def state(vehicle: VehicleUnderTest) -> str:
    """An upload changes mission_state from NO_MISSION to NOT_STARTED or COMPLETE; PX4 always reports 0."""
    empty, stored = vehicle.known(ardupilot=(1, (2, mavlink.MISSION_STATE_COMPLETE)), px4=(0, (0,)))
    plans.clear(vehicle)
    vehicle.wait(0.5)
    equal(_current(vehicle).mission_state, empty, "mission_state with no mission")
    plans.store_sample(vehicle)
    vehicle.wait(0.5)
    return f"{empty}, {one_of(_current(vehicle).mission_state, stored, 'mission_state')}"


@check(
    "mission.current",
    source="AUTOPILOTS 2: MISSION_SET_CURRENT (41) works; PX4 mavlink_mission.cpp, send: the result of the "
    "check after an upload, under a second later, brings back the old index",
)
def set_by_message(vehicle: VehicleUnderTest) -> None:
    """MISSION_SET_CURRENT makes an item current, and MISSION_CURRENT reports this item."""
    plans.store_sample(vehicle)
    vehicle.wait(CHECKED_S)
    for seq in (2, 1):
        flying.set_current(vehicle, seq)
        vehicle.expect("MISSION_CURRENT", partial(_is_item, seq), within_s=3.0)


@check("mission.current")
def beyond_the_end(vehicle: VehicleUnderTest) -> str:
    """MISSION_SET_CURRENT of a missing item does not make it current."""
    n_items = len(plans.store_sample(vehicle))
    flying.set_current(vehicle, n_items + 10)
    vehicle.wait(1.5)
    return f"seq {within(_current(vehicle).seq, 0, n_items - 1, 'current item')}"


@check("mission.current", source="AUTOPILOTS 2: DO_SET_MISSION_CURRENT (224)")
def set_by_command(vehicle: VehicleUnderTest) -> None:
    """DO_SET_MISSION_CURRENT is accepted by ArduPilot as LONG and INT, and UNSUPPORTED on PX4."""
    expected = vehicle.known(ardupilot=ACCEPTED, px4="UNSUPPORTED")
    plans.store_sample(vehicle)
    equal(vehicle.command(SET_CURRENT, 2), expected, "COMMAND_LONG")
    equal(vehicle.result(vehicle.command_int(SET_CURRENT, 3)), expected, "COMMAND_INT")
    if expected == ACCEPTED:
        equal(_current(vehicle).seq, 3, "seq")


@_ardupilot_check(source="AUTOPILOTS 2: out of range DENIED(2)")
def command_beyond_the_end(vehicle: VehicleUnderTest) -> str:
    """DO_SET_MISSION_CURRENT of a missing item is DENIED."""
    beyond = len(plans.store_sample(vehicle)) + 10
    return equal(vehicle.command(SET_CURRENT, beyond), "DENIED", "DO_SET_MISSION_CURRENT")


@_ardupilot_check(source="AUTOPILOTS 2: 0 = restart (goes to 1)")
def command_restart(vehicle: VehicleUnderTest) -> str:
    """DO_SET_MISSION_CURRENT 0 is accepted, and item 0 or 1 becomes current."""
    plans.store_sample(vehicle)
    vehicle.expect_accepted(SET_CURRENT, 0)
    return f"seq {within(_current(vehicle).seq, 0, 1, 'current item')}"


_RETURN = PlanItem(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
_Change = Callable[[PlanItem], PlanItem]


def _upload(vehicle: VehicleUnderTest, change: _Change, content: str, outcomes: Mapping[str, str]) -> str:
    """A take-off and a changed waypoint have the result of the autopilot; the key "" means all."""
    expected = outcomes[""] if "" in outcomes else vehicle.known(**outcomes)
    place = plans.current_position(vehicle)
    item = change(plans.waypoint(place, 30, 0))
    done = plans.upload(vehicle, plans.plan(vehicle, plans.takeoff(place), item))
    return equal(done.result, expected, content)


def _case(
    name: str, content: str, change: _Change, outcomes: dict[str, str], line: str = "error codes"
) -> Row:
    results = ", ".join(f"{autopilot} {result}".strip() for autopilot, result in outcomes.items())
    statement, source = f"A mission with {content}: {results}.", f"AUTOPILOTS 2: {line}"
    return row(
        name, statement, change, content, outcomes, dialects=tuple(filter(None, outcomes)), source=source
    )


checks(
    "mission.error", _upload,
    _case("nan_param1", "NaN as parameter 1", lambda i: replace(i, params=(math.nan, 0, 0, 0)),
          {"ardupilot": "INVALID_PARAM1"}),
    _case("nan_param2", "NaN as parameter 2", lambda i: replace(i, params=(0, math.nan, 0, 0)),
          {"ardupilot": "INVALID_PARAM2"}),
    _case("nan_altitude", "NaN as altitude", lambda i: replace(i, z=math.nan),
          {"ardupilot": "INVALID_PARAM7", "px4": "ACCEPTED"}),
    _case("latitude_100", "a latitude of 100 degrees", lambda i: replace(i, x=1_000_000_000),
          {"ardupilot": "INVALID_PARAM5_X", "px4": "ACCEPTED"}),
    _case("longitude_190", "a longitude of 190 degrees", lambda i: replace(i, y=1_900_000_000),
          {"ardupilot": "INVALID_PARAM6_Y"}),
    _case("jump_to_nowhere", "DO_JUMP to item 99",
          lambda _: PlanItem(mavlink.MAV_CMD_DO_JUMP, frame=mavlink.MAV_FRAME_MISSION, params=(99, 1, 0, 0)),
          {"ardupilot": "ERROR", "px4": "ACCEPTED"}),
    _case("far_away", "a place 50 km away", lambda i: replace(i, x=i.x + 4_500_000),
          {"ardupilot": "ACCEPTED", "px4": "ACCEPTED"}),
    _case("return_in_frame_6", "RETURN_TO_LAUNCH in frame 6", lambda _: replace(_RETURN, frame=6),
          {"ardupilot": "ACCEPTED", "px4": "UNSUPPORTED"}, "RTL item"),
    _case("return_in_frame_2", "RETURN_TO_LAUNCH in frame 2",
          lambda _: replace(_RETURN, frame=mavlink.MAV_FRAME_MISSION),
          {"ardupilot": "ACCEPTED", "px4": "ACCEPTED"}, "RTL item"),
    _case("unknown_command", "an unknown command", lambda i: replace(i, command=NO_SUCH_COMMAND),
          {"": "UNSUPPORTED"}),
    _case("unknown_frame", "a waypoint in MAV_FRAME_BODY_NED",
          lambda i: replace(i, frame=mavlink.MAV_FRAME_BODY_NED), {"": "UNSUPPORTED_FRAME"}),
)  # fmt: skip


@check("mission.error", source="AUTOPILOTS 2: error codes")
def too_many(vehicle: VehicleUnderTest) -> str:
    """MISSION_COUNT 3000 is refused with NO_SPACE by ArduPilot; PX4 requests the first item."""
    refuses = vehicle.known(ardupilot=True, px4=False)
    vehicle.send(plans.count_message(vehicle, 3000))
    if refuses:
        return equal(plans.next_result(vehicle), "NO_SPACE", "3000 items")
    equal(plans.next_request(vehicle), 0, "requested item")
    plans.cancel_upload(vehicle)
    return "item 0 requested"


@check("mission.error")
def item_without_upload(vehicle: VehicleUnderTest) -> str:
    """An item without an upload is refused and changes nothing."""
    items = plans.store_sample(vehicle)
    stray = plans.waypoint(plans.current_position(vehicle), 900, 900)
    vehicle.send(stray.message(vehicle.target, 1))
    result = refused(plans.next_result(vehicle))
    plans.expect_stored(vehicle, items)
    return result


PX4_PINS = "PX4 mavlink_mission.cpp, format_mavlink_mission_item"
PINS = "AUTOPILOTS 2: read-back differs"
LAND, LOITER_TIME = mavlink.MAV_CMD_NAV_LAND, mavlink.MAV_CMD_NAV_LOITER_TIME
TOLERANCE = 1e-4
_Fields = Mapping[str, Any]  # of an item


def _params(*values: float) -> dict[str, float]:
    return {f"param{number}": value for number, value in enumerate(values, 1)}


def _reads_back(vehicle: VehicleUnderTest, sent: _Fields, back: Mapping[str, _Fields]) -> str:
    expected = vehicle.known(**back)
    place = plans.current_position(vehicle)
    item: PlanItem = replace(plans.waypoint(place, 60, 40), **sent)
    plans.upload_or_fail(vehicle, plans.plan(vehicle, plans.takeoff(place), item))
    stored = plans.download(vehicle)[-1]
    seen = {name: getattr(stored, name) for name in expected}
    for name, value in expected.items():
        if math.isnan(value):
            equal(math.isnan(seen[name]), True, f"{name} is NaN")
        else:
            near(seen[name], value, TOLERANCE, name)
    return ", ".join(f"{name} {value:g}" for name, value in seen.items())


def _kept(name: str, statement: str, sent: _Fields, back: Mapping[str, _Fields], **conditions: Any) -> Row:
    """Return a row: changed fields of a waypoint, and by autopilot the fields read back; others are free."""
    only = {"dialects": tuple(back)} if len(back) == 1 else {}
    return row(name, statement, sent, back, **{"source": PINS, **only, **conditions})


checks(
    "mission.readback", _reads_back,
    _kept("relative_frame", "Frame 6 is read back as 3 on ArduPilot and as 6 on PX4.",
          {"frame": 6}, {"ardupilot": {"frame": 3}, "px4": {"frame": 6}}),
    _kept("global_frame", "Frame 0 is read back as 0 on ArduPilot and as 5 on PX4.",
          {"frame": 0, "z": 600}, {"ardupilot": {"frame": 0}, "px4": {"frame": 5}}),
    _kept("terrain_frame", "Frame 11 is read back as 10.",
          {"frame": 11}, {"ardupilot": {"frame": 10}}),
    _kept("mission_frame", "A waypoint in frame 2 is accepted and read back in frame 0.",
          {"frame": 2, "z": 600}, {"ardupilot": {"frame": 0}},
          source="AUTOPILOTS 2: frame 2 (MISSION) on a WP"),
    _kept("altitude",
          "20.3 m is read back as 20.29 m on ArduPilot (truncated to centimetres) and as 20.3 m on PX4.",
          {"z": 20.3}, {"ardupilot": {"z": 20.29}, "px4": {"z": 20.3}}),
    _kept("altitude_thirds", "33.333 m is read back as 33.33 m on ArduPilot and as 33.333 m on PX4.",
          {"z": 33.333}, {"ardupilot": {"z": 33.33}, "px4": {"z": 33.333}}),
    _kept("waypoint_parameters",
          "Parameters (2.7, 5, 6, 90) are read back as (2, 0, 0, 0) on ArduPilot, as (2.7, 5, 0, 90) on "
          "PX4.",
          {"params": (2.7, 5, 6, 90)},
          {"ardupilot": _params(2, 0, 0, 0), "px4": _params(2.7, 5, 0, 90)},
          kind="copter", source=f"{PINS}; {PX4_PINS}"),
    _kept("negative_yaw", "A yaw of -90 degrees is read back as 270 degrees.",
          {"params": (0, 0, 0, -90)}, {"px4": {"param4": 270}}, source=PX4_PINS),
    _kept("takeoff_parameters", "Parameters 1 to 3 of a take-off are read back as 0.",
          {"command": mavlink.MAV_CMD_NAV_TAKEOFF, "params": (15, 1, 2, 45)},
          {"px4": _params(0, 0, 0, 45)}, source=PX4_PINS),
    _kept("nan_yaw", "NaN as parameter 4 is read back as 0 on ArduPilot and as NaN on PX4.",
          {"params": (0, 0, 0, math.nan)}, {"ardupilot": {"param4": 0}, "px4": {"param4": math.nan}}),
    _kept("loiter_time", "A radius of 25 m in LOITER_TIME is read back as 1, the direction.",
          {"command": LOITER_TIME, "params": (12, 0, 25, 0)},
          {"ardupilot": {"param1": 12, "param3": 1}}),
    _kept("land_yaw", "Parameter 4 of LAND, sent as 0, is read back as 1.",
          {"command": LAND, "z": 0}, {"ardupilot": {"param4": 1}}, kind="copter"),
    _kept("frame_without_place", "DO_CHANGE_SPEED in frame 2 is read back in frame 0.",
          {"command": mavlink.MAV_CMD_DO_CHANGE_SPEED, "x": 0, "y": 0, "z": 0, "frame": 2,
           "params": (1, 5, -1, 0)},
          {"ardupilot": {"frame": 0, "param2": 5}}, source="AUTOPILOTS 2: non-position items ->0"),
)  # fmt: skip


@check("mission.readback", dialects=("ardupilot",), source="AUTOPILOTS 2: current is 0 on every item")
def current_flag(vehicle: VehicleUnderTest) -> None:
    """The field `current` of every item is read back as 0."""
    plans.store_sample(vehicle)
    equal({item.current for item in plans.download(vehicle)}, {0}, "current")
