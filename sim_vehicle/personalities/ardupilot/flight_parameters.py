"""ArduPilot's parameters converted to flight parameters."""

import math
from collections.abc import Callable, Mapping, Sequence

from sim_vehicle.files.logs.record import LogWhen
from sim_vehicle.physics.copter import HOVER_THROTTLE
from sim_vehicle.physics.following import Following, Gains
from sim_vehicle.vehicle import flight_parameters as fp
from sim_vehicle.vehicle.flight_parameters import FailsafeAction, FlightParameters
from sim_vehicle.vehicle.params import Parameters
from sim_vehicle.vehicle.sticks import PilotLimits

MIN_SPEED_M_S, MAX_SPEED_M_S = 0.1, 50.0
MIN_RETURN_HEIGHT_M, MIN_CONE_SLOPE = 0.3, 0.5
# ARMING_DELAY_SEC (2 s), twice MOT_SPOOL_TIME (0.5 s), and the throttle's rise to its hover value, at
# TKOFF_SLEW_TIME (2 s) for the full throttle; ArduCopter 4.6.2 reports the take-off after 3.4 to 3.8 s
LIFT_OFF_S = 3.8
TAKEOFF_REACHED_M = 0.1  # a take-off in a mission ends where the climb ends, not at the acceptance radius
FENCE_GIVE_UP_M = 100.0  # distance beyond a fence limit at which a copter lands
STALL_M_S = 8.0  # for a plane with AIRSPEED_STALL 0
FENCE_ALT_MAX, FENCE_CIRCLE, FENCE_POLYGONS, FENCE_ALT_MIN = 1, 2, 4, 8  # bits of FENCE_TYPE
# No simulated vehicle has SmartRTL, so "SmartRTL or X" means X in each table.
_BATTERY_ACTIONS = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.LAND,
    2: FailsafeAction.RETURN,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
    5: FailsafeAction.TERMINATE,
    6: FailsafeAction.RETURN,
    7: FailsafeAction.HOLD,
}
_PLANE_BATTERY_ACTIONS = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.TERMINATE,
    4: FailsafeAction.LAND,  # QLAND: without VTOL motors the same as LAND
    5: FailsafeAction.WARN,  # no simulated vehicle has a parachute
    6: FailsafeAction.LAND,
    7: FailsafeAction.RETURN,  # "AUTOLAND or RTL": RTL, as AUTOLAND requires an automatic take-off
}
_LINK_ACTIONS = {
    0: FailsafeAction.NOTHING,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.RETURN,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
    5: FailsafeAction.LAND,
    6: FailsafeAction.RETURN,
    7: FailsafeAction.HOLD,
}
_THROTTLE_ACTIONS = {
    0: FailsafeAction.NOTHING,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.RETURN,
    3: FailsafeAction.LAND,
    4: FailsafeAction.RETURN,
    5: FailsafeAction.LAND,
    6: FailsafeAction.RETURN,
    7: FailsafeAction.HOLD,
}
_FENCE_ACTIONS = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.HOLD,
    5: FailsafeAction.RETURN,
}
_PLANE_FENCE_ACTIONS = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    6: FailsafeAction.RETURN_POINT,
    7: FailsafeAction.RETURN_POINT,
    8: FailsafeAction.RETURN,  # "AUTOLAND or RTL", here and below
}
_EKF_ACTIONS = {0: FailsafeAction.WARN, 1: FailsafeAction.LAND, 2: FailsafeAction.HOLD_ALTITUDE}
EKF_LANDS_EVERYWHERE = 3  # value of FS_EKF_ACTION
# Modes of a plane by number. With FS_LONG_ACTN 0, AUTO, GUIDED and RTL continue after a long link loss.
FBWA, FBWB = 5, 6
PLANE_RC_TIMEOUT_S = 1.0  # Plane::rc_failsafe_active
_PILOTED = (0, 2, FBWA, FBWB, 7)
_CIRCLE, _RTL, _AUTO, _LOITER, _TAKEOFF, _GUIDED = 1, 11, 10, 12, 13, 15
_MODES_RETURNING_AFTER_LONG_LOSS = (*_PILOTED, _CIRCLE, _LOITER, _TAKEOFF)
_MODES_WITHOUT_SHORT_ACTION = (_CIRCLE, _TAKEOFF, _RTL)
_PLANE_LONG_ACTIONS = {
    0: FailsafeAction.WARN,
    1: FailsafeAction.RETURN,
    2: FailsafeAction.GLIDE,
    3: FailsafeAction.WARN,  # no simulated vehicle has a parachute
    4: FailsafeAction.MISSION,
    5: FailsafeAction.RETURN,
}
_PLANE_SHORT_ACTIONS = {
    0: FailsafeAction.HOLD,
    1: FailsafeAction.HOLD,
    2: FailsafeAction.GLIDE,
    3: None,
    4: FailsafeAction.LEVEL,
}
# Modes of a copter, and bits of FS_OPTIONS for modes that continue without a link.
_COPTER_PILOTED = (0, 1, 2, 5, 16, 17)  # BRAKE (17) counts as a pilot's mode
_COPTER_AUTO, _COPTER_GUIDED = 3, 4
RC_AUTO, GCS_AUTO, RC_GUIDED, GCS_PILOTED = 1, 2, 4, 16


def _m_s(params: Parameters, *names: str) -> float:
    """Return the first nonzero value [cm/s] in m/s, limited to MIN_SPEED_M_S and MAX_SPEED_M_S."""
    value = next((params[name] for name in names if params[name] != 0), 0.0)
    return min(max(value / 100, MIN_SPEED_M_S), MAX_SPEED_M_S)


def _battery(params: Parameters, actions: Mapping[int, FailsafeAction]) -> fp.BatteryParameters:
    capacity_mah = params["BATT_CAPACITY"]

    def level(event: str, name: str, action: str) -> fp.BatteryLevel:
        share = params[f"BATT_{name}_MAH"] / max(capacity_mah, 1.0)
        return fp.BatteryLevel(
            event, params[f"BATT_{name}_VOLT"], share, actions.get(int(params[action]), FailsafeAction.WARN)
        )

    return fp.BatteryParameters(
        capacity_mah=capacity_mah,
        full_v=params["SIM_BATT_VOLTAGE"],
        levels=(
            level("battery_low", "LOW", "BATT_FS_LOW_ACT"),
            level("battery_critical", "CRT", "BATT_FS_CRT_ACT"),
        ),
        delay_s=params["BATT_LOW_TIMER"],
    )


def _fence(
    params: Parameters, action: FailsafeAction, *, return_height_m: float = 0.0, give_up_m: float = math.inf
) -> fp.FenceParameters:
    bits = int(params["FENCE_TYPE"])
    return fp.FenceParameters(
        enabled=params["FENCE_ENABLE"] == 1,
        action=action,
        max_height_m=params["FENCE_ALT_MAX"] if bits & FENCE_ALT_MAX else math.inf,
        min_height_m=params["FENCE_ALT_MIN"] if bits & FENCE_ALT_MIN else -math.inf,
        radius_m=params["FENCE_RADIUS"] if bits & FENCE_CIRCLE else math.inf,
        polygons=bool(bits & FENCE_POLYGONS),
        margin_m=params["FENCE_MARGIN"],
        return_height_m=return_height_m,
        give_up_m=give_up_m,
    )


def _rally(params: Parameters, altitude: fp.RallyAltitude) -> fp.RallyParameters:
    limit_m = params["RALLY_LIMIT_KM"] * 1000
    return fp.RallyParameters(limit_m if limit_m > 0 else math.inf, altitude, params["RALLY_INCL_HOME"] == 1)


def _wind(params: Parameters) -> tuple[float | None, float]:
    return params["SIM_WIND_SPD"] if params["SIM_WIND_SPD"] > 0 else None, params["SIM_WIND_DIR"]


def _logs(params: Parameters) -> LogWhen:
    if params["LOG_BACKEND_TYPE"] == 0:
        return LogWhen.NEVER
    return LogWhen.ALWAYS if params["LOG_DISARMED"] != 0 else LogWhen.ARMED


def _return_height(params: Parameters) -> Callable[[float, float], float]:
    """Return the function for the height of a return (`ReturnParameters.height_at`).

    The height is RTL_ALT, limited near home by RTL_CONE_SLOPE, but at least RTL_CLIMB_MIN above the vehicle.
    """
    full_m, climb_m = params["RTL_ALT"] / 100, max(params["RTL_CLIMB_MIN"], 0.0) / 100
    slope = params["RTL_CONE_SLOPE"]

    def return_height_m(distance_m: float, height_m: float) -> float:
        minimum_m = max(MIN_RETURN_HEIGHT_M, height_m + climb_m)
        without_cone_m, cone_m = max(full_m, minimum_m), max(slope * distance_m, minimum_m)
        return without_cone_m if slope < MIN_CONE_SLOPE else min(without_cone_m, cone_m)

    return return_height_m


def _continuing_modes(options: int, *modes: tuple[int, Sequence[int]]) -> dict[int, FailsafeAction]:
    """Return FailsafeAction.NOTHING for each mode whose bit in `options` is set.

    `modes`: pairs of a bit and its mode numbers.
    """
    return {number: FailsafeAction.NOTHING for bit, numbers in modes if options & bit for number in numbers}


def _following(params: Parameters) -> Following:
    """Return ArduCopter's shaping of set-points (`shape_pos_vel_accel`)."""

    def gains(jerk: str, acceleration_m_s2: float) -> Gains:
        jerk_m_s3 = min(max(params[jerk], 1.0), 50.0)
        return Gains(
            position_hz=0.5 * jerk_m_s3 / acceleration_m_s2,
            velocity_hz=jerk_m_s3 / acceleration_m_s2,
            acceleration_m_s2=acceleration_m_s2,
            braking_m_s2=0.5 * acceleration_m_s2,
            jerk_m_s3=jerk_m_s3,
        )

    return Following(
        horizontal=gains("PSC_JERK_XY", max(params["WPNAV_ACCEL"], 10.0) / 100),
        vertical=gains("PSC_JERK_Z", max(params["WPNAV_ACCEL_Z"], 10.0) / 100),
        target_moves=True,
        faces_course=True,
    )


def copter_flight_parameters(params: Parameters) -> FlightParameters:
    """Convert ArduCopter's parameters."""
    options = int(params["AUTO_OPTIONS"])
    disarm_s = params["DISARM_DELAY"] if params["DISARM_DELAY"] > 0 else math.inf
    gcs_action = _LINK_ACTIONS.get(int(params["FS_GCS_ENABLE"]), FailsafeAction.RETURN)
    rc_action = _THROTTLE_ACTIONS.get(int(params["FS_THR_ENABLE"]), FailsafeAction.LAND)
    fs_options, ekf_action = int(params["FS_OPTIONS"]), int(params["FS_EKF_ACTION"])
    return FlightParameters(
        limits=fp.Limits(
            speed_m_s=_m_s(params, "WPNAV_SPEED"),
            climb_m_s=_m_s(params, "WPNAV_SPEED_UP"),
            descent_m_s=_m_s(params, "WPNAV_SPEED_DN"),
            acceleration_m_s2=max(params["WPNAV_ACCEL"], 10.0) / 100,
            vertical_acceleration_m_s2=max(params["WPNAV_ACCEL_Z"], 10.0) / 100,
            autopilot_jerk_m_s3=max(params["PSC_JERK_XY"], 1.0),
            acceptance_radius_m=max(params["WPNAV_RADIUS"], 10.0) / 100,
            yaw_rate_deg_s=max(params["ATC_SLEW_YAW"], 500.0) / 100,
            lift_off_s=LIFT_OFF_S,
        ),
        battery=_battery(params, _BATTERY_ACTIONS),
        arming=fp.ArmingParameters(
            checks=params["ARMING_CHECK"] != 0,
            in_mission_mode=bool(options & 1),
            disarm_landed_s=disarm_s,
            disarm_unflown_s=disarm_s,
        ),
        takeoff=fp.TakeoffParameters(height_m=10.0, reached_m=TAKEOFF_REACHED_M),
        mission=fp.MissionParameters(
            takes_off=bool(options & 2),
            restarts=params["MIS_RESTART"] == 1,
            begins_legs_at_rest=True,
            leg_jerk_m_s3=max(params["WPNAV_JERK"], 1.0),
            zero_keeps_altitude=True,
        ),
        returning=fp.ReturnParameters(
            height_m=params["RTL_ALT"] / 100,
            speed_m_s=_m_s(params, "RTL_SPEED", "WPNAV_SPEED"),
            wait_s=params["RTL_LOIT_TIME"] / 1000,
            height_at=_return_height(params),
            under_fence=True,
            final_height_m=params["RTL_ALT_FINAL"] / 100 if params["RTL_ALT_FINAL"] > 0 else None,
        ),
        rally=_rally(params, fp.RallyAltitude.MINIMUM),
        landing=fp.LandingParameters(
            speed_m_s=_m_s(params, "LAND_SPEED"),
            slow_below_m=params["LAND_ALT_LOW"] / 100,
            speed_high_m_s=_m_s(params, "LAND_SPEED_HIGH", "WPNAV_SPEED_DN"),
        ),
        pilot=PilotLimits(
            lean_deg=params["ANGLE_MAX"] / 100,
            yaw_rate_deg_s=params["PILOT_Y_RATE"],
            climb_m_s=_m_s(params, "PILOT_SPEED_UP"),
            descent_m_s=_m_s(params, "PILOT_SPEED_DN", "PILOT_SPEED_UP"),
            vertical_acceleration_m_s2=max(params["PILOT_ACCEL_Z"], 10.0) / 100,
            speed_m_s=_m_s(params, "LOIT_SPEED"),
            acceleration_m_s2=max(params["LOIT_ACC_MAX"], 10.0) / 100,
            throttle_deadzone=params["THR_DZ"] / 1000,
            hover_throttle=HOVER_THROTTLE,
            throttle_curve=True,
            lean_keeps_lift=True,
        ),
        gcs=fp.GcsParameters(
            sysid=int(params["SYSID_MYGCS"]),
            timeout_s=params["FS_GCS_TIMEOUT"] if gcs_action is not FailsafeAction.NOTHING else math.inf,
            action=fp.LinkAction(
                gcs_action,
                _continuing_modes(fs_options, (GCS_AUTO, [_COPTER_AUTO]), (GCS_PILOTED, _COPTER_PILOTED)),
            ),
            only=params["SYSID_ENFORCE"] == 1,
        ),
        rc=fp.RcParameters(
            timeout_s=params["RC_FS_TIMEOUT"],
            action=fp.LinkAction(
                rc_action,
                _continuing_modes(fs_options, (RC_AUTO, [_COPTER_AUTO]), (RC_GUIDED, [_COPTER_GUIDED])),
            ),
            watched=rc_action is not FailsafeAction.NOTHING,
            failed=params["SIM_RC_FAIL"] == 1,
        ),
        setpoints=fp.SetpointParameters(
            max(params["GUID_TIMEOUT"], 0.1), FailsafeAction.HOLD, following=_following(params)
        ),
        position=fp.PositionParameters(
            lost_action=_EKF_ACTIONS.get(ekf_action, FailsafeAction.LAND),
            watched=params["FS_EKF_THRESH"] > 0,
            lost_everywhere=ekf_action == EKF_LANDS_EVERYWHERE,
        ),
        fence=_fence(
            params,
            _FENCE_ACTIONS.get(int(params["FENCE_ACTION"]), FailsafeAction.RETURN),
            give_up_m=FENCE_GIVE_UP_M,
        ),
        wind=_wind(params),
        logs=_logs(params),
    )


def _fence_return_height_m(params: Parameters) -> float:
    """Return FENCE_RET_ALT, else the middle of the fence altitudes, else RTL_ALTITUDE; above home [m]."""
    if params["FENCE_RET_ALT"] > 0:
        return params["FENCE_RET_ALT"]
    lowest_m = params["FENCE_ALT_MIN"] + params["FENCE_MARGIN"]
    highest_m = params["FENCE_ALT_MAX"] - params["FENCE_MARGIN"]
    return params["RTL_ALTITUDE"] if lowest_m >= highest_m else (lowest_m + highest_m) / 2


def plane_flight_parameters(params: Parameters) -> FlightParameters:
    """Convert ArduPlane's parameters."""
    gcs_watched = params["FS_GCS_ENABL"] != 0
    long_action = fp.LinkAction(
        _PLANE_LONG_ACTIONS.get(int(params["FS_LONG_ACTN"]), FailsafeAction.WARN),
        dict.fromkeys(_MODES_RETURNING_AFTER_LONG_LOSS, FailsafeAction.RETURN)
        if params["FS_LONG_ACTN"] == 0
        else {},
    )
    short = int(params["FS_SHORT_ACTN"])
    short_action = _PLANE_SHORT_ACTIONS.get(short, FailsafeAction.HOLD)
    without_short_action = (
        (*_MODES_WITHOUT_SHORT_ACTION, _AUTO, _GUIDED, _LOITER) if short == 0 else _MODES_WITHOUT_SHORT_ACTION
    )
    return FlightParameters(
        limits=fp.Limits(
            speed_m_s=params["AIRSPEED_CRUISE"],
            climb_m_s=max(params["TECS_CLMB_MAX"], MIN_SPEED_M_S),
            descent_m_s=max(params["TECS_SINK_MAX"], MIN_SPEED_M_S),
            acceleration_m_s2=3.0,
            vertical_acceleration_m_s2=3.0,
            acceptance_radius_m=max(params["WP_RADIUS"], 1.0),
            airspeed_min_m_s=params["AIRSPEED_MIN"],
            airspeed_max_m_s=params["AIRSPEED_MAX"],
            loiter_radius_m=params["WP_LOITER_RAD"],
            bank_limit_deg=params["ROLL_LIMIT_DEG"],
            stall_m_s=params["AIRSPEED_STALL"] if params["AIRSPEED_STALL"] > 0 else STALL_M_S,
        ),
        battery=_battery(params, _PLANE_BATTERY_ACTIONS),
        arming=fp.ArmingParameters(
            checks=params["ARMING_CHECK"] != 0,
            disarm_landed_s=params["LAND_DISARMDELAY"] if params["LAND_DISARMDELAY"] > 0 else math.inf,
        ),
        takeoff=fp.TakeoffParameters(height_m=params["TKOFF_ALT"]),
        mission=fp.MissionParameters(restarts=params["MIS_RESTART"] == 1, loiter_leaves_aligned=True),
        returning=fp.ReturnParameters(
            height_m=params["RTL_ALTITUDE"] if params["RTL_ALTITUDE"] >= 0 else -math.inf,
            speed_m_s=params["AIRSPEED_CRUISE"],
            wait_s=math.inf,  # circles over home; only a mission lands the plane
            descends=params["RTL_ALTITUDE"] >= 0,
            loiter_radius_m=params["RTL_RADIUS"],
            lands=int(params["RTL_AUTOLAND"]),
        ),
        rally=_rally(params, fp.RallyAltitude.EXACT),
        landing=fp.LandingParameters(
            speed_m_s=2.0, slow_below_m=10.0, speed_high_m_s=max(params["TECS_SINK_MAX"], MIN_SPEED_M_S)
        ),
        pilot=PilotLimits(
            lean_deg=params["ROLL_LIMIT_DEG"],
            climb_m_s=params["FBWB_CLIMB_RATE"],
            descent_m_s=params["FBWB_CLIMB_RATE"],
            pitch_up_deg=params["PTCH_LIM_MAX_DEG"],
            pitch_down_deg=-params["PTCH_LIM_MIN_DEG"],
        ),
        gcs=fp.GcsParameters(
            sysid=int(params["SYSID_MYGCS"]),
            timeout_s=params["FS_LONG_TIMEOUT"] if gcs_watched else math.inf,
            action=long_action if gcs_watched else fp.LinkAction(FailsafeAction.NOTHING, long_action.by_mode),
            only=params["SYSID_ENFORCE"] == 1,
        ),
        rc=fp.RcParameters(
            timeout_s=PLANE_RC_TIMEOUT_S,
            action=long_action,
            short_action=None
            if short_action is None
            else fp.LinkAction(short_action, dict.fromkeys(without_short_action, FailsafeAction.NOTHING)),
            long_s=params["FS_LONG_TIMEOUT"],
            watched=params["THR_FAILSAFE"] == 1,
            failed=params["SIM_RC_FAIL"] == 1,
        ),
        setpoints=fp.SetpointParameters(3.0, FailsafeAction.HOLD),
        position=fp.PositionParameters(FailsafeAction.WARN),  # continues by dead reckoning
        fence=_fence(
            params,
            _PLANE_FENCE_ACTIONS.get(int(params["FENCE_ACTION"]), FailsafeAction.WARN),
            return_height_m=_fence_return_height_m(params),
        ),
        wind=_wind(params),
        logs=_logs(params),
    )
