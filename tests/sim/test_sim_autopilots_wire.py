"""ArduCopter on the wire: ids, sizes and kinds of messages, moving home, and returns as items."""

import pytest
from files_client import FileStation
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, home_item, item, land, place_m, station_of, takeoff, waypoint

from sim_vehicle.personalities import personality_of

AUTO = 3


@pytest.mark.autopilots("1.16", "MAVSDK 5 params")
def test_parameters_have_the_type_of_their_default_and_a_float_value() -> None:
    station = station_of(params={"RTL_ALT": 2000.0, "WPNAV_SPEED": 500.0})
    station.send(mavlink.MAVLink_param_request_list_message(1, 0))
    values = {m.param_id: m for m in station.of("PARAM_VALUE")}
    for name, kind, value in (
        ("DISARM_DELAY", mavlink.MAV_PARAM_TYPE_INT8, 10.0),
        ("SYSID_MYGCS", mavlink.MAV_PARAM_TYPE_INT16, 255.0),
        ("RTL_ALT", mavlink.MAV_PARAM_TYPE_INT32, 2000.0),
        ("WPNAV_SPEED", mavlink.MAV_PARAM_TYPE_REAL32, 500.0),
    ):
        assert (values[name].param_type, values[name].param_value) == (kind, value)


@pytest.mark.autopilots("1.11")
def test_a_return_ends_at_the_place_of_the_last_arming() -> None:
    station = Station()
    station.fly_mission([takeoff(10), waypoint(100, 0, 10), land(100, 0)])
    station.until(lambda: not station.armed, 120)
    station.fly(10)
    assert station.reposition(160, 10) == 0
    station.until(lambda: place_m(station)[0] > 158, 60)
    assert station.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == 0
    station.until(lambda: not station.armed, 120)
    assert place_m(station)[0] == pytest.approx(100, abs=1.5)


@pytest.mark.autopilots("1.11")
def test_relative_altitudes_count_from_the_place_of_the_last_arming() -> None:
    station = Station()
    station.fly(30)
    switch = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    assert station.command(switch, 0, 21_196) == 0  # arms at another height
    station.wait(0.5)
    assert station.command(switch, 1, 21_196) == 0
    position = station.ask(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT)
    assert abs(position.relative_alt) < 500
    assert position.alt > 320_000
    assert station.download() == []
    assert station.of("HOME_POSITION")[-1].altitude == pytest.approx(position.alt, abs=500)


@pytest.mark.autopilots("1.12")
def test_a_return_item_is_flown_in_auto() -> None:
    station = Station()
    rtl = item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    station.fly_mission([takeoff(10), waypoint(40, 0, 10), rtl])
    begun = len(station.received)
    station.until(lambda: not station.armed, 120)
    station.wait(5)
    beats = [m for m in station.received[begun:] if m.get_type() == "HEARTBEAT"]
    assert {m.custom_mode for m in beats} == {AUTO}


@pytest.mark.autopilots("2 RTL item")
@pytest.mark.parametrize("frame", [0, 3, 5, 10, 11])
def test_a_return_is_accepted_in_any_frame(frame: int) -> None:
    station = Station()
    rtl = item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=frame)
    assert station.upload([home_item(), takeoff(), rtl]) == mavlink.MAV_MISSION_ACCEPTED


@pytest.mark.autopilots("2 frame 2 on a WP")
def test_a_waypoint_in_the_mission_frame_is_flown_above_mean_sea_level() -> None:
    station = Station()
    station.fly_mission([takeoff(10), waypoint(50, 0, 325.0, frame=2), waypoint(50, 30, 25)])
    station.until(lambda: 2 in [m.seq for m in station.of("MISSION_ITEM_REACHED")], 90)
    assert station.height_m == pytest.approx(25, abs=2.1)  # 300 m is the ground; within the radius


@pytest.mark.autopilots("1.16")
@pytest.mark.parametrize(
    ("name", "sent", "kept"),
    [
        ("FENCE_ENABLE", 300.0, 127.0),
        ("FENCE_ENABLE", -300.0, -128.0),
        ("SYSID_MYGCS", 1e6, 32_767.0),
        ("RTL_ALT", 100_000.0, 100_000.0),
        ("RTL_SPEED", 99.6, 99.0),  # cut, not rounded
        ("RTL_SPEED", 99.995, 100.0),  # rounding errors of whole numbers are corrected
        ("RTL_SPEED", -1.9, -1.0),
        ("WPNAV_SPEED", 123.5, 123.5),
        ("SYSID_THISMAV", 9.0, 1.0),  # cannot be set
    ],
)
def test_an_integer_parameter_is_limited_to_its_width(name: str, sent: float, kept: float) -> None:
    assert Station().set_parameter(name, sent).param_value == kept


@pytest.mark.parametrize("kind", ["copter", "plane"])
def test_every_integer_parameter_has_a_declared_width(kind: str) -> None:
    personality = personality_of("ardupilot", kind)
    integers = {name for name, value in personality.parameters.defaults.items() if isinstance(value, int)}
    assert integers - set(personality.parameters.bits) == set()


def test_the_file_of_all_parameters_has_their_widths() -> None:
    station = FileStation()
    station.send(mavlink.MAVLink_param_request_list_message(1, 0))
    names = [m.param_id for m in station.of("PARAM_VALUE")]
    for name, kind in (("FENCE_ENABLE", 1), ("SYSID_MYGCS", 2), ("RTL_ALT", 3), ("RTL_CONE_SLOPE", 4)):
        content = station.file(b"@PARAM/param.pck?start=%d&count=1" % names.index(name))
        assert (content[8 : 8 + len(name)].decode(), content[6] & 15) == (name, kind)
