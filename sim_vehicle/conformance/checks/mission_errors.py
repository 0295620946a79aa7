"""Results of uploads with invalid or unusual items."""

import math
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.assertions import equal, holds, mission_result_name
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest, known_behaviour
from sim_vehicle.station.plan_items import MISSION, PlanItem

NO_SUCH_COMMAND = 31_900


def _outcome(vehicle: VehicleUnderTest, item: PlanItem) -> str:
    """Return the result of an upload of a take-off and this item."""
    done = plans.upload(vehicle, plans.plan(vehicle, plans.takeoff(plans.current_position(vehicle)), item))
    return mission_result_name(done.result)


def _outcome_check(
    change: Callable[[PlanItem], PlanItem], content: str, **outcomes: str | None
) -> Callable[[VehicleUnderTest], str]:
    def run(vehicle: VehicleUnderTest) -> str:
        expected = known_behaviour(vehicle, **outcomes)
        seen = _outcome(vehicle, change(plans.waypoint(plans.current_position(vehicle), 30, 0)))
        equal(seen, expected, content)
        return seen

    run.__doc__ = f"A mission with {content}: {', '.join(f'{k} {v}' for k, v in outcomes.items())}."
    return run


_CASES: tuple[tuple[str, str, Callable[[PlanItem], PlanItem], dict[str, str]], ...] = (
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
    ("return_in_frame_6", "RETURN_TO_LAUNCH in frame 6",
     lambda _: PlanItem(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=6),
     {"ardupilot": "ACCEPTED", "px4": "UNSUPPORTED"}),
    ("return_in_frame_2", "RETURN_TO_LAUNCH in frame 2",
     lambda _: PlanItem(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=mavlink.MAV_FRAME_MISSION),
     {"ardupilot": "ACCEPTED", "px4": "ACCEPTED"}),
)  # fmt: skip


for _name, _content, _change, _outcomes in _CASES:
    _row = "RTL item" if _name.startswith("return_") else "error codes"
    check(f"mission.error.{_name}", dialects=tuple(_outcomes), source=f"AUTOPILOTS 2: {_row}")(
        _outcome_check(_change, _content, **_outcomes)
    )


@check("mission.error.unknown_command", source="AUTOPILOTS 2: error codes")
def unknown_command(vehicle: VehicleUnderTest) -> str:
    """An item with an unknown command is UNSUPPORTED."""
    equal(
        _outcome(
            vehicle, replace(plans.waypoint(plans.current_position(vehicle), 30, 0), command=NO_SUCH_COMMAND)
        ),
        "UNSUPPORTED",
        "item",
    )
    return "UNSUPPORTED"


@check("mission.error.unknown_frame", source="AUTOPILOTS 2: error codes")
def unknown_frame(vehicle: VehicleUnderTest) -> str:
    """A waypoint in MAV_FRAME_BODY_NED is UNSUPPORTED_FRAME."""
    item = plans.waypoint(plans.current_position(vehicle), 30, 0, frame=mavlink.MAV_FRAME_BODY_NED)
    equal(_outcome(vehicle, item), "UNSUPPORTED_FRAME", "item")
    return "UNSUPPORTED_FRAME"


@check("mission.error.too_many", source="AUTOPILOTS 2: error codes", limit_s=40)
def too_many(vehicle: VehicleUnderTest) -> str:
    """MISSION_COUNT 3000 is refused with NO_SPACE by ArduPilot; PX4 requests the first item."""
    refuses = known_behaviour(vehicle, ardupilot=True, px4=False)
    mark = vehicle.mark()
    vehicle.send(plans.count_message(vehicle, 3000))
    if refuses:
        ack = vehicle.expect("MISSION_ACK", plans.for_station(MISSION), mark=mark)
        equal(mission_result_name(ack.type), "NO_SPACE", "3000 items")
        return "NO_SPACE"
    _, seq = plans.next_request(vehicle, MISSION, mark=mark)
    equal(seq, 0, "requested item")
    plans.cancel_upload(vehicle)
    return "item 0 requested"


@check("mission.error.item_without_upload")
def item_without_upload(vehicle: VehicleUnderTest) -> str:
    """An item without an upload is refused and changes nothing."""
    items = plans.sample_plan(vehicle)
    plans.upload_or_fail(vehicle, items)
    mark = vehicle.mark()
    vehicle.send(plans.waypoint(plans.current_position(vehicle), 900, 900).message(vehicle.target, 1))
    ack = vehicle.expect("MISSION_ACK", plans.for_station(MISSION), mark=mark)
    holds(ack.type != mavlink.MAV_MISSION_ACCEPTED, "expected a refusal, saw ACCEPTED")
    equal(plans.coordinates(vehicle, plans.download(vehicle)), plans.coordinates(vehicle, items), "items")
    return mission_result_name(ack.type)
