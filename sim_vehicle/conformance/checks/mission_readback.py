"""What an autopilot keeps of an item: it is read back otherwise than it was sent."""

import math
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import plans
from sim_vehicle.conformance.peer import Peer, known
from sim_vehicle.conformance.plans import Item
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import equal, near

PINS = "AUTOPILOTS 2: read-back differs"


def _point(peer: Peer, **changes: Any) -> Item:
    return replace(plans.waypoint(plans.here(peer), 60, 40), **changes)


@check("mission.readback.relative_frame", pins=PINS)
def relative_frame(peer: Peer) -> str:
    """Frame 6 comes back as 3 from ArduPilot, as 6 from PX4."""
    expected = known(peer, ardupilot=3, px4=6)
    equal(plans.store(peer, _point(peer, frame=6)).frame, expected, "frame")
    return f"6 -> {expected}"


@check("mission.readback.global_frame", pins=PINS)
def global_frame(peer: Peer) -> str:
    """Frame 0 comes back as 0 from ArduPilot, as 5 from PX4."""
    expected = known(peer, ardupilot=0, px4=5)
    equal(plans.store(peer, _point(peer, frame=0, z=600)).frame, expected, "frame")
    return f"0 -> {expected}"


@check("mission.readback.terrain_frame", dialects=("ardupilot",), pins=PINS)
def terrain_frame(peer: Peer) -> str:
    """Frame 11 comes back as 10."""
    equal(plans.store(peer, _point(peer, frame=11)).frame, 10, "frame")
    return "11 -> 10"


@check(
    "mission.readback.mission_frame", dialects=("ardupilot",), pins="AUTOPILOTS 2: frame 2 (MISSION) on a WP"
)
def mission_frame(peer: Peer) -> str:
    """A waypoint in frame 2 is accepted and kept as one above sea level."""
    equal(plans.store(peer, _point(peer, frame=2, z=600)).frame, 0, "frame")
    return "2 -> 0"


@check("mission.readback.altitude", pins=PINS)
def altitude(peer: Peer) -> str:
    """20.3 m comes back as 20.29 from ArduPilot (whole centimetres, cut), as 20.3 from PX4."""
    expected = known(peer, ardupilot=20.29, px4=20.3)
    near(plans.store(peer, _point(peer, z=20.3)).z, expected, 1e-3, "z")
    return f"20.3 -> {expected}"


@check("mission.readback.altitude_thirds", pins=PINS)
def altitude_thirds(peer: Peer) -> str:
    """33.333 m comes back as 33.33 from ArduPilot."""
    expected = known(peer, ardupilot=33.33, px4=33.333)
    near(plans.store(peer, _point(peer, z=33.333)).z, expected, 5e-4, "z")
    return f"33.333 -> {expected}"


@check("mission.readback.waypoint_parameters", kind="copter", pins=PINS)
def waypoint_parameters(peer: Peer) -> str:
    """Of (2.7, 5, 6, 90) ArduPilot keeps (2, 0, 0, 0), PX4 everything."""
    sent = (2.7, 5.0, 6.0, 90.0)
    expected = known(peer, ardupilot=(2.0, 0.0, 0.0, 0.0), px4=sent)
    item = plans.store(peer, _point(peer, params=sent))
    for number, (value, wanted) in enumerate(
        zip((item.param1, item.param2, item.param3, item.param4), expected, strict=True), start=1
    ):
        near(value, wanted, 1e-5, f"param{number}")
    return f"{sent} -> {expected}"


@check("mission.readback.nan_yaw", pins=PINS)
def nan_yaw(peer: Peer) -> str:
    """NaN as parameter 4 comes back as 0 from ArduPilot, as NaN from PX4."""
    keeps = known(peer, ardupilot=False, px4=True)
    value = plans.store(peer, _point(peer, params=(0, 0, 0, math.nan))).param4
    equal(math.isnan(value), keeps, "NaN kept")
    return f"NaN -> {value:g}"


@check("mission.readback.loiter_time", dialects=("ardupilot",), pins=PINS)
def loiter_time(peer: Peer) -> str:
    """LOITER_TIME keeps of a radius of 25 only its direction."""
    item = _point(peer, command=mavlink.MAV_CMD_NAV_LOITER_TIME, params=(12, 0, 25, 0))
    seen = plans.store(peer, item)
    equal((seen.param1, seen.param3), (12.0, 1.0), "param1, param3")
    return "25 -> 1"


@check("mission.readback.land_yaw", dialects=("ardupilot",), kind="copter", pins=PINS)
def land_yaw(peer: Peer) -> str:
    """LAND's parameter 4 comes back as 1."""
    equal(plans.store(peer, _point(peer, command=mavlink.MAV_CMD_NAV_LAND, z=0)).param4, 1.0, "param4")
    return "0 -> 1"


@check(
    "mission.readback.current_flag", dialects=("ardupilot",), pins="AUTOPILOTS 2: current is 0 on every item"
)
def current_flag(peer: Peer) -> str:
    """No item is marked as current."""
    plans.put(peer, plans.sample_plan(peer))
    equal({item.current for item in plans.download(peer)}, {0}, "current")
    return "0"


@check(
    "mission.readback.frame_without_place",
    dialects=("ardupilot",),
    pins="AUTOPILOTS 2: non-position items ->0",
)
def frame_without_place(peer: Peer) -> str:
    """DO_CHANGE_SPEED sent in frame 2 comes back in frame 0."""
    item = Item(mavlink.MAV_CMD_DO_CHANGE_SPEED, frame=mavlink.MAV_FRAME_MISSION, params=(1, 5, -1, 0))
    seen = plans.store(peer, item)
    equal((seen.frame, seen.param2), (0, 5.0), "frame, param2")
    return "2 -> 0"
