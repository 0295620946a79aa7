"""Checks of the current mission item."""

from functools import partial
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying, plans
from sim_vehicle.conformance.assertions import ACCEPTED, equal, holds, within
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest

CHECKED_S = 2.0  # longest time until PX4 has checked a new mission
NO_MISSION_TOTAL = 65_535
SET_CURRENT = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
_ardupilot_check = partial(check, dialects=("ardupilot",))


def _current(vehicle: VehicleUnderTest) -> Any:
    return vehicle.request("MISSION_CURRENT")


def _has_been_current(vehicle: VehicleUnderTest, mark: int, seq: int) -> bool:
    """Return True if MISSION_CURRENT has reported item `seq` since the mark."""
    return any(message.seq == seq for message in vehicle.since(mark, "MISSION_CURRENT"))


@check("mission.current.total", source="AUTOPILOTS 2: MISSION_CURRENT.total does not include home")
def current_total(vehicle: VehicleUnderTest) -> str:
    """MISSION_CURRENT.total is the number of items without home; an unknown autopilot may report 0."""
    n_items = len(plans.store_sample(vehicle)) - int(vehicle.dialect.home_item)
    total = _current(vehicle).total
    if not vehicle.dialect.known and total == 0:
        return "not reported"
    return str(equal(total, n_items, "total"))


@check("mission.current.total_of_nothing", source="AUTOPILOTS 2: total 65535 with no mission")
def total_of_nothing(vehicle: VehicleUnderTest) -> str:
    """Without a mission, total is 65535 on PX4 and 0 or 65535 on ArduPilot."""
    allowed = vehicle.known(ardupilot={0, NO_MISSION_TOTAL}, px4={NO_MISSION_TOTAL})
    plans.clear(vehicle)
    vehicle.wait(1.0)
    total = _current(vehicle).total
    holds(total in allowed, f"expected one of {sorted(allowed)}, saw {total}")
    return str(total)


@check("mission.current.state", source="AUTOPILOTS 2: mission_state is 0 always (PX4)")
def current_state(vehicle: VehicleUnderTest) -> str:
    """An upload changes mission_state from NO_MISSION to NOT_STARTED or COMPLETE; PX4 always reports 0."""
    empty, stored = vehicle.known(ardupilot=(1, (2, mavlink.MISSION_STATE_COMPLETE)), px4=(0, (0,)))
    plans.clear(vehicle)
    vehicle.wait(0.5)
    equal(_current(vehicle).mission_state, empty, "mission_state with no mission")
    plans.store_sample(vehicle)
    vehicle.wait(0.5)
    state = _current(vehicle).mission_state
    holds(state in stored, f"mission_state: expected one of {stored}, saw {state}")
    return f"{empty}, {state}"


@check(
    "mission.current.set_by_message",
    source="AUTOPILOTS 2: MISSION_SET_CURRENT (41) works; PX4 mavlink_mission.cpp, send: the result of the "
    "check after an upload, under a second later, brings back the old index",
)
def set_by_message(vehicle: VehicleUnderTest) -> str:
    """MISSION_SET_CURRENT makes an item current, and MISSION_CURRENT reports this item."""
    plans.store_sample(vehicle)
    vehicle.wait(CHECKED_S)
    for seq in (2, 1):
        mark = flying.set_current(vehicle, seq)
        vehicle.wait_until(partial(_has_been_current, vehicle, mark, seq), f"MISSION_CURRENT {seq}", 3.0)
    return "2, then 1"


@check("mission.current.beyond_the_end")
def set_beyond_the_end(vehicle: VehicleUnderTest) -> str:
    """MISSION_SET_CURRENT of a missing item does not make it current."""
    n_items = len(plans.store_sample(vehicle))
    flying.set_current(vehicle, n_items + 10)
    vehicle.wait(1.5)
    return f"seq {within(_current(vehicle).seq, 0, n_items - 1, 'current item')}"


@check("mission.current.set_by_command", source="AUTOPILOTS 2: DO_SET_MISSION_CURRENT (224)")
def set_by_command(vehicle: VehicleUnderTest) -> str:
    """DO_SET_MISSION_CURRENT is accepted by ArduPilot as LONG and INT, and UNSUPPORTED on PX4."""
    expected = vehicle.known(ardupilot=ACCEPTED, px4="UNSUPPORTED")
    plans.store_sample(vehicle)
    equal(vehicle.command(SET_CURRENT, 2), expected, "COMMAND_LONG")
    equal(vehicle.result(vehicle.command_int(SET_CURRENT, 3)), expected, "COMMAND_INT")
    if expected == ACCEPTED:
        equal(_current(vehicle).seq, 3, "seq")
    return str(expected)


@_ardupilot_check("mission.current.command_beyond_the_end", source="AUTOPILOTS 2: out of range DENIED(2)")
def command_beyond_the_end(vehicle: VehicleUnderTest) -> str:
    """DO_SET_MISSION_CURRENT of a missing item is DENIED."""
    beyond = len(plans.store_sample(vehicle)) + 10
    return equal(vehicle.command(SET_CURRENT, beyond), "DENIED", "DO_SET_MISSION_CURRENT")


@_ardupilot_check("mission.current.command_restart", source="AUTOPILOTS 2: 0 = restart (goes to 1)")
def command_restart(vehicle: VehicleUnderTest) -> str:
    """DO_SET_MISSION_CURRENT 0 is accepted, and item 0 or 1 becomes current."""
    plans.store_sample(vehicle)
    vehicle.expect_accepted(SET_CURRENT, 0)
    return f"seq {within(_current(vehicle).seq, 0, 1, 'current item')}"
