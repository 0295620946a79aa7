"""MAVSDK's telemetry, info and param plug-ins with vehicles on the ground."""

import math
from collections.abc import Iterator
from typing import Any

import pytest
from mavsdk_peer import MavsdkPeer, StreamedValues, Vehicle, connected, refusal, side_by_side

pytestmark = [pytest.mark.interop, pytest.mark.full]
SPEEDUP = 5.0
RATED = (
    "position", "home", "in_air", "landed_state", "vtol_state", "attitude_quaternion", "attitude_euler",
    "velocity_ned", "gps_info", "raw_gps", "battery", "rc_status", "position_velocity_ned", "imu",
    "fixedwing_metrics", "scaled_imu", "unix_epoch_time", "health", "distance_sensor",
)  # fmt: skip
RATED_BY = {
    "ardupilot": {"raw_imu"},
    "px4": {"altitude", "ground_truth", "odometry", "actuator_output_status"},
}
NEVER_RATED = "actuator_control_target"  # removed from PX4 in 1.14, never in ArduPilot


@pytest.fixture(scope="module")
def peer() -> Iterator[MavsdkPeer]:
    with connected("--personality", "ardupilot:4,px4:4", "--speedup", str(SPEEDUP)) as found:
        yield found


def first(vehicle: Vehicle, stream: str) -> Any:
    """Return the next value of a stream."""
    values = StreamedValues()
    getattr(vehicle.telemetry, f"subscribe_{stream}")(values, None)
    return values.next()


# -- telemetry -------------------------------------------------------------------------------------------


@pytest.mark.autopilots("MAVSDK 5 telemetry")
@pytest.mark.autopilots("MAVSDK 5 telemetry", of="px4")
@side_by_side
def test_telemetry_has_the_requested_rate(peer: MavsdkPeer, personality: str) -> None:
    vehicle = peer.take(personality, telemetry=False)
    telemetry = vehicle.telemetry
    if not vehicle.px4:
        first(vehicle, "armed")  # from the heartbeat, the only message
        assert math.isnan(telemetry.position().latitude_deg)
        assert math.isnan(telemetry.battery().voltage_v)
    own_streams = RATED_BY[personality]
    for stream in (*RATED, *own_streams):
        getattr(telemetry, f"set_rate_{stream}")(10.0)
    other_streams = RATED_BY["ardupilot" if vehicle.px4 else "px4"]
    for stream in (*other_streams, NEVER_RATED):
        refused = refusal(getattr(telemetry, f"set_rate_{stream}"), 10.0)
        assert refused == ("UNKNOWN" if vehicle.px4 else "COMMAND_DENIED")  # MAVSDK maps FAILED to this
    for rate_hz in (10.0, 2.0):
        telemetry.set_rate_attitude_euler(rate_hz)
        values = StreamedValues()
        handle = telemetry.subscribe_attitude_euler(values, None)
        for _ in range(6):
            values.next()
        telemetry.unsubscribe_attitude_euler(handle)
        stamps = [value.timestamp_us for value in values.seen[1:]]
        assert stamps[-1] - stamps[0] == pytest.approx((len(stamps) - 1) * 1e6 / rate_hz, rel=0.01)


# -- info ------------------------------------------------------------------------------------------------


@side_by_side
def test_the_info_plugin_has_version_identity_and_speed_factor(peer: MavsdkPeer, personality: str) -> None:
    vehicle, other = peer.take(personality), peer.take(personality)
    version = vehicle.info.get_version()
    numbers = (version.flight_sw_major, version.flight_sw_minor, version.flight_sw_patch)
    assert numbers == ((1, 15, 2) if vehicle.px4 else (4, 6, 2))
    assert version.flight_sw_version_type.name == "RELEASE"
    assert vehicle.info.get_product().vendor_name == "undefined"
    ids = {v.info.get_identification().hardware_uid for v in (vehicle, other)}
    assert len(ids) == 2
    first(vehicle, "attitude_euler")
    vehicle.until(lambda: factor(vehicle) is not None, "speed factor", 10)
    # The factor comes from the time between two messages; a busy machine bunches messages.
    assert factor(vehicle) == pytest.approx(SPEEDUP, rel=0.8)


def factor(vehicle: Vehicle) -> float | None:
    try:
        value = float(vehicle.info.get_speed_factor())
    except Exception as error:
        if getattr(error, "result", None) is None:
            raise
        return None
    return value if math.isfinite(value) else None


# -- parameters ------------------------------------------------------------------------------------------

INT_AND_FLOAT = {
    "ardupilot": ("FENCE_ENABLE", "FENCE_ALT_MAX"),
    "px4": ("COM_FLTMODE1", "MPC_XY_CRUISE"),
}


@pytest.mark.autopilots("MAVSDK 5 params", "1.16")
@pytest.mark.autopilots("1.16", of="px4")
@side_by_side
def test_parameters_of_both_types(peer: MavsdkPeer, personality: str) -> None:
    vehicle = peer.take(personality)
    param = vehicle.param
    whole, real = INT_AND_FLOAT[personality]
    for value in (-1, 6, 2**31 - 1) if vehicle.px4 else (1, 0):
        param.set_param_int(whole, value)
        assert param.get_param_int(whole) == value
    param.set_param_float(real, 4.25)
    assert param.get_param_float(real) == 4.25
    assert refusal(param.get_param_int, real) == "WRONG_TYPE"
    assert refusal(param.get_param_float, whole) == "WRONG_TYPE"
    every = param.get_all_params()
    ints = {p.name: p.value for p in every.int_params}
    floats = {p.name: p.value for p in every.float_params}
    assert whole in ints
    assert floats[real] == 4.25
    number = vehicle.system.get_system_id()
    assert ints["MAV_SYS_ID" if vehicle.px4 else "SYSID_THISMAV"] == number


# -- actions that are refused ----------------------------------------------------------------------------
