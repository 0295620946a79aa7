"""Results of uploads with invalid or unusual items."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import equal, refused
from sim_vehicle.conformance.registry import CheckFunction, check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.station.plan_items import PlanItem

NO_SUCH_COMMAND = 31_900
_RETURN = PlanItem(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
_Change = Callable[[PlanItem], PlanItem]


def _upload_check(change: _Change, content: str, outcomes: Mapping[str, str]) -> CheckFunction:
    """Return a check of the upload of a take-off and a changed waypoint, by autopilot or for all ("")."""

    def run(vehicle: VehicleUnderTest) -> str:
        expected = outcomes[""] if "" in outcomes else vehicle.known(**outcomes)
        place = plans.current_position(vehicle)
        item = change(plans.waypoint(place, 30, 0))
        done = plans.upload(vehicle, plans.plan(vehicle, plans.takeoff(place), item))
        return equal(done.result, expected, content)

    run.__doc__ = f"A mission with {content}: {', '.join(f'{k} {v}'.strip() for k, v in outcomes.items())}."
    return run


_CASES: tuple[tuple[str, str, _Change, dict[str, str]], ...] = (
    ("nan_param1", "NaN as parameter 1", lambda i: replace(i, params=(math.nan, 0, 0, 0)),
     {"ardupilot": "INVALID_PARAM1"}),
    ("nan_param2", "NaN as parameter 2", lambda i: replace(i, params=(0, math.nan, 0, 0)),
     {"ardupilot": "INVALID_PARAM2"}),
    ("nan_altitude", "NaN as altitude", lambda i: replace(i, z=math.nan),
     {"ardupilot": "INVALID_PARAM7", "px4": "ACCEPTED"}),
    ("latitude_100", "a latitude of 100 degrees", lambda i: replace(i, x=1_000_000_000),
     {"ardupilot": "INVALID_PARAM5_X", "px4": "ACCEPTED"}),
    ("longitude_190", "a longitude of 190 degrees", lambda i: replace(i, y=1_900_000_000),
     {"ardupilot": "INVALID_PARAM6_Y"}),
    ("jump_to_nowhere", "DO_JUMP to item 99",
     lambda _: PlanItem(mavlink.MAV_CMD_DO_JUMP, frame=mavlink.MAV_FRAME_MISSION, params=(99, 1, 0, 0)),
     {"ardupilot": "ERROR", "px4": "ACCEPTED"}),
    ("far_away", "a place 50 km away", lambda i: replace(i, x=i.x + 4_500_000),
     {"ardupilot": "ACCEPTED", "px4": "ACCEPTED"}),
    ("return_in_frame_6", "RETURN_TO_LAUNCH in frame 6", lambda _: replace(_RETURN, frame=6),
     {"ardupilot": "ACCEPTED", "px4": "UNSUPPORTED"}),
    ("return_in_frame_2", "RETURN_TO_LAUNCH in frame 2",
     lambda _: replace(_RETURN, frame=mavlink.MAV_FRAME_MISSION),
     {"ardupilot": "ACCEPTED", "px4": "ACCEPTED"}),
    ("unknown_command", "an unknown command", lambda i: replace(i, command=NO_SUCH_COMMAND),
     {"": "UNSUPPORTED"}),
    ("unknown_frame", "a waypoint in MAV_FRAME_BODY_NED",
     lambda i: replace(i, frame=mavlink.MAV_FRAME_BODY_NED), {"": "UNSUPPORTED_FRAME"}),
)  # fmt: skip
for _name, _content, _change, _outcomes in _CASES:
    _row = "RTL item" if _name.startswith("return_") else "error codes"
    check(f"mission.error.{_name}", dialects=tuple(filter(None, _outcomes)), source=f"AUTOPILOTS 2: {_row}")(
        _upload_check(_change, _content, _outcomes)
    )


@check("mission.error.too_many", source="AUTOPILOTS 2: error codes", limit_s=40)
def too_many(vehicle: VehicleUnderTest) -> str:
    """MISSION_COUNT 3000 is refused with NO_SPACE by ArduPilot; PX4 requests the first item."""
    refuses = vehicle.known(ardupilot=True, px4=False)
    mark = vehicle.send(plans.count_message(vehicle, 3000))
    if refuses:
        return equal(plans.next_result(vehicle, mark), "NO_SPACE", "3000 items")
    equal(plans.next_request(vehicle, mark=mark), 0, "requested item")
    plans.cancel_upload(vehicle)
    return "item 0 requested"


@check("mission.error.item_without_upload")
def item_without_upload(vehicle: VehicleUnderTest) -> str:
    """An item without an upload is refused and changes nothing."""
    items = plans.store_sample(vehicle)
    stray = plans.waypoint(plans.current_position(vehicle), 900, 900)
    result = refused(plans.next_result(vehicle, vehicle.send(stray.message(vehicle.target, 1))))
    plans.expect_stored(vehicle, items)
    return result
