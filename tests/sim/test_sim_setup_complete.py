"""Parameters and files that ground stations need, read over the wire.

QGroundControl cannot run here. Each rule is the one by which its source decides that a component of a vehicle
is set up (AutoPilotPlugins/APM and PX4, `setupComplete`). Summaries and pages read further parameters.
"""

import struct
from collections.abc import Callable

import pytest
from files_client import FileStation
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from station import Station, station_of

from sim_vehicle.files.ftp_rules import Opcode

Values = Callable[[str], float]  # name -> value of a parameter; AssertionError without an answer


def value(station: Station, name: str) -> float:
    replies = station.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    found = [m for m in replies if m.get_type() == "PARAM_VALUE" and m.param_id == name]
    assert found, f"{name} is not answered"
    byte_wise = station.fleet.vehicles[0].personality.parameters.byte_wise
    if byte_wise and found[0].param_type != mavlink.MAV_PARAM_TYPE_REAL32:
        return float(struct.unpack("<i", struct.pack("<f", found[0].param_value))[0])
    return float(found[0].param_value)


def compass_is_calibrated(number: str) -> Callable[[Values], bool]:
    def rule(get: Values) -> bool:
        used = get(f"COMPASS_DEV_ID{number}") != 0 and get(f"COMPASS_USE{number}") != 0
        return used and all(get(f"COMPASS_OFS{number}_{axis}") != 0 for axis in "XYZ")

    return rule


def radio_is_calibrated(get: Values) -> bool:
    channels = [int(get(f"RCMAP_{name}")) for name in ("ROLL", "PITCH", "YAW", "THROTTLE")]
    ends = {(get(f"RC{n}_MIN"), get(f"RC{n}_MAX"), get(f"RC{n}_TRIM")) for n in channels}
    return min(channels) > 0 and ends != {(1100.0, 1900.0, 1500.0)}


ARDUPILOT, PX4 = "ardupilot", "px4"
RULES: dict[str, tuple[str, Callable[[Values], bool]]] = {
    "accelerometer": (ARDUPILOT, lambda get: any(get(f"INS_ACCOFFS_{axis}") != 0 for axis in "XYZ")),
    "compass 1": (ARDUPILOT, compass_is_calibrated("")),
    "compass 2": (ARDUPILOT, compass_is_calibrated("2")),
    "compass 3": (ARDUPILOT, compass_is_calibrated("3")),
    "radio": (ARDUPILOT, radio_is_calibrated),
    "battery": (ARDUPILOT, lambda get: get("BATT_MONITOR") != 0 and get("BATT_CAPACITY") != 0),
    "airframe": (PX4, lambda get: get("SYS_AUTOSTART") != 0),
    "sensors": (PX4, lambda get: all(get(f"CAL_{name}0_ID") != 0 for name in ("MAG", "GYRO", "ACC"))),
    "airspeed": (PX4, lambda get: get("SENS_DPRES_OFF") != 0),
    "joystick instead of a radio": (PX4, lambda get: get("COM_RC_IN_MODE") == 1),
    "power": (PX4, lambda get: get("BAT1_V_CHARGED") * get("BAT1_V_EMPTY") * get("BAT1_N_CELLS") != 0),
}
READ: dict[str, tuple[str, ...]] = {  # by autopilot: parameters that summaries and pages read
    ARDUPILOT: (
        "AHRS_ORIENTATION", "BARO1_DEVID", "BATT2_MONITOR", "BATT_AMP_PERVLT", "BATT_ARM_VOLT",
        "BATT_VOLT_MULT", "COMPASS_CAL_FIT", "COMPASS_EXTERN2", "COMPASS_LEARN", "COMPASS_ORIENT3",
        "COMPASS_PRIO1_ID", "FENCE_AUTOENABLE", "FLTMODE1", "FLTMODE6", "FLTMODE_CH", "GPS1_TYPE",
        "INS_ACC3_ID", "INS_GYR_ID", "RC16_OPTION", "RC6_OPTION", "SERVO4_FUNCTION", "TERRAIN_ENABLE",
    ),
    PX4: (
        "BAT1_SOURCE", "BAT1_V_LOAD_DROP", "CAL_MAG1_ID", "CAL_MAG2_ID", "COM_FLTMODE1", "COM_RC_LOSS_T",
        "CP_DIST", "NAV_RCL_ACT", "RC_MAP_AUX1", "RC_MAP_AUX2", "RC_MAP_FLAPS", "RC_MAP_FLTMODE",
        "RTL_LAND_DELAY",
    ),
}  # fmt: skip
BOTH_KINDS = pytest.mark.parametrize("kind", ["copter", "plane"])


@BOTH_KINDS
@pytest.mark.parametrize("component", list(RULES))
def test_a_component_needs_no_setup(component: str, kind: str) -> None:
    personality, is_complete = RULES[component]
    station = station_of(kind, personality=personality)
    assert is_complete(lambda name: value(station, name))


def test_the_frame_of_a_copter_needs_no_setup_and_a_plane_has_none() -> None:
    assert value(station_of("copter"), "FRAME_CLASS") == 1
    with pytest.raises(AssertionError):
        value(station_of("plane"), "FRAME_CLASS")


@pytest.mark.parametrize(
    ("kind", "name", "width"),
    [
        ("copter", "RC_FS_TIMEOUT", mavlink.MAV_PARAM_TYPE_REAL32),
        ("plane", "RC_FS_TIMEOUT", None),
        ("plane", "FBWB_CLIMB_RATE", mavlink.MAV_PARAM_TYPE_INT8),
        ("copter", "FBWB_CLIMB_RATE", None),
    ],
)
def test_parameters_of_one_kind_have_the_type_of_the_firmware(
    kind: str, name: str, width: int | None
) -> None:
    station = station_of(kind)
    replies = station.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    types = [m.param_type for m in replies if m.get_type() == "PARAM_VALUE"]
    assert types == ([] if width is None else [width])


@BOTH_KINDS
@pytest.mark.parametrize("personality", list(READ))
def test_each_parameter_of_a_ground_stations_page_is_answered(personality: str, kind: str) -> None:
    station = station_of(kind, personality=personality)
    for name in READ[personality]:
        value(station, name)


# -- files -----------------------------------------------------------------------------------------------


def test_ardupilots_system_files_are_listed_and_the_same_ones_can_be_read() -> None:
    station = FileStation()
    listing = station.ftp(Opcode.LIST_DIRECTORY, b"@SYS")
    names = {line[1:].split(b"\t")[0].decode() for line in listing.strip(b"\0").split(b"\0")}
    assert names == {
        "can0_stats.txt", "can1_stats.txt", "can_log.txt", "crash_dump.bin", "dma.txt", "memory.txt",
        "storage.bin", "tasks.txt", "threads.txt", "timers.txt", "uarts.txt",
    }  # fmt: skip
    readable = {"storage.bin", "tasks.txt", "uarts.txt"}
    for name in sorted(names - readable):
        with pytest.raises(AssertionError, match="FILE_NOT_FOUND"):
            station.file(f"@SYS/{name}".encode())
    assert station.file(b"@SYS/storage.bin")
    assert station.file(b"@SYS/tasks.txt") == b"TasksV2\n"
    assert station.file(b"@SYS/uarts.txt").startswith(b"UARTV1\nSERIAL0 ")
