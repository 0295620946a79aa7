"""MAVSDK's telemetry, info, param and action plug-ins with vehicles on the ground."""

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from mavsdk.plugins.action import OrbitYawBehavior, RelayCommand
from mavsdk.plugins.telemetry import FixType, FlightMode, LandedState, Odometry
from mavsdk_peer import MavsdkPeer, StreamedValues, Vehicle, connected, refusal, side_by_side

pytestmark = [pytest.mark.interop, pytest.mark.full]
SPEEDUP = 5.0
LAT_DEG, LON_DEG, ALT_M, HEADING_DEG = 47.397742, 8.545594, 488.0, 30.0
EPOCH_2020_US = 1_577_836_800_000_000
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
    home = f"{LAT_DEG},{LON_DEG},{ALT_M},{HEADING_DEG}"
    fleet = ("--personality", "ardupilot:8,px4:9", "--home", home, "--speedup", str(SPEEDUP))
    with connected(*fleet) as found:
        yield found


@pytest.fixture(scope="module")
def unready() -> Iterator[MavsdkPeer]:
    with connected(
        "--personality", "ardupilot:1,px4:1", "--speedup", str(SPEEDUP), "--ready-s", "600"
    ) as found:
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


@pytest.mark.autopilots("MAVSDK 5 telemetry")
@pytest.mark.autopilots("MAVSDK 5 telemetry", of="px4")
@side_by_side
def test_telemetry_of_a_vehicle_on_the_ground(peer: MavsdkPeer, personality: str) -> None:
    vehicle = peer.take(personality)
    telemetry = vehicle.telemetry
    for stream in (
        "landed_state",
        "battery",
        "gps_info",
        "unix_epoch_time",
        "attitude_quaternion",
        "raw_gps",
    ):
        getattr(telemetry, f"set_rate_{stream}")(10.0)
    vehicle.ready()
    here, home = telemetry.position(), telemetry.home()
    assert here.latitude_deg == pytest.approx(LAT_DEG, abs=2e-5)
    assert here.longitude_deg == pytest.approx(LON_DEG, abs=2e-3)  # the vehicles stand in a row
    assert here.absolute_altitude_m == pytest.approx(ALT_M, abs=1.5)
    assert here.relative_altitude_m == pytest.approx(0, abs=1.5)
    assert home.latitude_deg == pytest.approx(here.latitude_deg, abs=1e-5)
    assert home.absolute_altitude_m == pytest.approx(here.absolute_altitude_m, abs=1.5)
    assert telemetry.heading().heading_deg == pytest.approx(HEADING_DEG, abs=0.1)
    euler, q = first(vehicle, "attitude_euler"), first(vehicle, "attitude_quaternion")
    assert (euler.roll_deg, euler.pitch_deg) == (pytest.approx(0, abs=1), pytest.approx(0, abs=1))
    assert math.degrees(2 * math.atan2(q.z, q.w)) == pytest.approx(euler.yaw_deg, abs=0.5)
    assert vehicle.ground_speed_m_s < 0.3
    gps = first(vehicle, "gps_info")
    assert gps.num_satellites == 10
    assert gps.fix_type == (FixType.FIX_3D if vehicle.px4 else FixType.RTK_FIXED)
    battery = first(vehicle, "battery")
    assert battery.voltage_v == pytest.approx(16.2 if vehicle.px4 else 12.6, abs=0.2)
    assert battery.remaining_percent == pytest.approx(100, abs=1)
    assert first(vehicle, "landed_state") == LandedState.ON_GROUND
    assert first(vehicle, "unix_epoch_time") > EPOCH_2020_US
    assert not telemetry.armed()
    assert not telemetry.in_air()
    assert vehicle.mode == (FlightMode.HOLD if vehicle.px4 else FlightMode.STABILIZED)
    origin = telemetry.get_gps_global_origin()
    assert origin.latitude_deg == pytest.approx(LAT_DEG, abs=2e-5)
    assert origin.altitude_m == pytest.approx(ALT_M, abs=1.5)


def test_streams_of_px4_only(peer: MavsdkPeer) -> None:
    vehicle = peer.take("px4")
    telemetry = vehicle.telemetry
    for stream in RATED_BY["px4"]:
        getattr(telemetry, f"set_rate_{stream}")(10.0)
    vehicle.ready()
    assert first(vehicle, "altitude").altitude_amsl_m == pytest.approx(ALT_M, abs=1.5)
    truth = first(vehicle, "ground_truth")
    assert truth.latitude_deg == pytest.approx(telemetry.position().latitude_deg, abs=1e-5)
    odometry = first(vehicle, "odometry")
    assert (
        odometry.frame_id == Odometry.MavFrame.UNDEF
    )  # MAVSDK has local frames only for vision and estimators
    assert math.hypot(odometry.position_body.x_m, odometry.position_body.y_m) < 1.5
    assert first(vehicle, "actuator_output_status").active == 4
    assert first(vehicle, "scaled_pressure").absolute_pressure_hpa == pytest.approx(956, abs=3)
    assert first(vehicle, "wind").wind_x_ned_m_s == pytest.approx(0, abs=0.5)


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


@pytest.mark.autopilots("1.16")
def test_unanswered_requests_time_out(peer: MavsdkPeer) -> None:
    """MAVSDK waits three seconds for each; they run in parallel."""
    get, older = peer.take("ardupilot"), peer.take("ardupilot")
    unknown, wrong = peer.take("px4"), peer.take("px4")

    def no_such_of_ardupilot() -> None:
        assert refusal(get.param.get_param_int, "NO_SUCH") == "TIMEOUT"
        assert get.param.get_param_int("RTL_ALT") == 1500

    def later_of_ardupilot() -> None:
        # MAVSDK requests a parameter of later versions first.
        older.action.set_return_to_launch_altitude(27.0)
        assert older.param.get_param_int("RTL_ALT") == 2700

    def no_such_of_px4() -> None:
        assert refusal(unknown.param.set_param_float, "NO_SUCH", 1.0) == "TIMEOUT"
        unknown.action.set_return_to_launch_altitude(27.0)
        assert unknown.action.get_return_to_launch_altitude() == 27.0

    def wrong_type_of_px4() -> None:
        assert refusal(wrong.param.set_param_int, "MPC_XY_CRUISE", 3) == "TIMEOUT"  # not an integer parameter
        assert wrong.param.get_param_float("MPC_XY_CRUISE") == 5.0

    silent = (no_such_of_ardupilot, later_of_ardupilot, no_such_of_px4, wrong_type_of_px4)
    with ThreadPoolExecutor(len(silent)) as pool:
        for done in [pool.submit(ask) for ask in silent]:
            done.result(timeout=30)


# -- actions that are refused ----------------------------------------------------------------------------


@pytest.mark.autopilots("MAVSDK 5 takeoff")
@pytest.mark.autopilots("MAVSDK 5 takeoff", of="px4")
@side_by_side
def test_refusals_of_a_vehicle_on_the_ground(peer: MavsdkPeer, personality: str) -> None:
    vehicle = peer.take(personality)
    vehicle.ready()
    action, here = vehicle.action, vehicle.telemetry.position()
    place = (here.latitude_deg, here.longitude_deg, here.absolute_altitude_m + 10)
    action.set_takeoff_altitude(7.5)
    assert action.get_takeoff_altitude() == 7.5
    action.disarm()  # already disarmed
    if vehicle.px4:
        action.takeoff()  # a mode that can be set on the ground
        assert vehicle.param.get_param_float("MIS_TAKEOFF_ALT") == 7.5
    else:
        assert refusal(action.takeoff) == "FAILED"
    action.hold()
    vehicle.in_mode(FlightMode.HOLD)
    orbit = (10.0, 2.0, OrbitYawBehavior.HOLD_FRONT_TO_CIRCLE_CENTER, *place)
    assert refusal(action.do_orbit, *orbit) == ("COMMAND_DENIED" if vehicle.px4 else "UNSUPPORTED")
    for _ in range(2):  # the first may be for other plug-ins
        first(vehicle, "vtol_state")
    assert refusal(action.transition_to_fixedwing) == "NO_VTOL_TRANSITION_SUPPORT"
    assert refusal(action.set_relay, 0, RelayCommand.ON) == "UNSUPPORTED"
    assert refusal(action.shutdown) == ("COMMAND_DENIED" if vehicle.px4 else "UNSUPPORTED")
    if vehicle.px4:
        assert refusal(action.terminate) == "COMMAND_DENIED"
        action.set_gps_global_origin(place[0], place[1], here.absolute_altitude_m)
    else:
        # An estimator with an origin keeps that origin and does not answer.
        assert refusal(action.set_gps_global_origin, *place) == "TIMEOUT"
    north_deg = here.latitude_deg + 0.001
    # MAVSDK sends the altitude in a frame relative to home; only PX4 reads it as above mean sea level.
    action.set_home(False, north_deg, here.longitude_deg, here.absolute_altitude_m - 10)
    vehicle.until(lambda: abs(vehicle.telemetry.home().latitude_deg - north_deg) < 1e-6, "home moved", 10)
    assert not vehicle.telemetry.armed()


@pytest.mark.autopilots("1.3", "1.18")
@side_by_side
def test_early_arming_is_refused_with_a_reason_and_a_reboot_restarts_the_boot(
    unready: MavsdkPeer, personality: str
) -> None:
    vehicle = unready.take(personality)
    vehicle.until(lambda: vehicle.telemetry.attitude_euler().timestamp_us > 4e6, "4 s after boot")
    refused = refusal(vehicle.action.arm)
    assert refused == ("COMMAND_DENIED" if vehicle.px4 else "FAILED")
    reason = "ekf2 missing data" if vehicle.px4 else "Arm: AHRS: waiting for home"
    vehicle.until(lambda: any(reason in text for text in vehicle.texts), "a reason", 10)
    assert not vehicle.telemetry.health_all_ok()
    assert not vehicle.telemetry.health().is_armable
    vehicle.action.reboot()
    back: Callable[[], bool] = lambda: vehicle.telemetry.attitude_euler().timestamp_us < 4e6  # noqa: E731
    if not vehicle.px4:
        first(vehicle, "armed")
        vehicle.ask_for_telemetry()  # a reboot ends its streams
    vehicle.until(back, "a clock that restarted", 20)
