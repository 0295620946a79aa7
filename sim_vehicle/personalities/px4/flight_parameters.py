"""PX4's parameters converted to flight parameters."""

import math
from collections.abc import Callable

from sim_vehicle.files.logs.record import LogWhen
from sim_vehicle.personalities.px4 import modes
from sim_vehicle.physics.copter import TILT_TIME_S
from sim_vehicle.physics.following import Following, Gains
from sim_vehicle.physics.motion import GRAVITY_M_S2
from sim_vehicle.vehicle import flight_parameters as fp
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.flight_parameters import FailsafeAction, FlightParameters
from sim_vehicle.vehicle.params import Parameters
from sim_vehicle.vehicle.sticks import PilotLimits

HeightAt = Callable[[float, float], float]
MIN_SPEED_M_S = 0.1
DEFAULT_CAPACITY_MAH = 5000.0
LIFT_OFF_S = 4.0  # COM_SPOOLUP_TIME (1 s) and the ramp of the thrust, MPC_TKO_RAMP_T (3 s)
NO_STICKS = 4  # value of COM_RC_IN_MODE
MAX_IGNORED_DELAY_S = 0.1  # COM_FAIL_ACT_T up to this value counts as 0

# NAV_DLL_ACT and NAV_RCL_ACT
_LINK_ACTIONS = {
    0: FailsafeAction.NOTHING,
    1: FailsafeAction.HOLD,
    2: FailsafeAction.RETURN,
    3: FailsafeAction.LAND,
    5: FailsafeAction.TERMINATE,
    6: FailsafeAction.DISARM,
}
_FENCE_ACTIONS = {
    0: FailsafeAction.NOTHING,
    1: FailsafeAction.WARN,
    2: FailsafeAction.HOLD,
    3: FailsafeAction.RETURN,
    4: FailsafeAction.TERMINATE,
    5: FailsafeAction.LAND,
}
# COM_LOW_BAT_ACT at the critical and at the emergency level
_CRITICAL_ACTIONS = {
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.RETURN,
}
_EMERGENCY_ACTIONS = {
    1: FailsafeAction.RETURN,
    2: FailsafeAction.LAND,
    3: FailsafeAction.LAND,
}
# COM_OBL_RC_ACT; the first three values are pilot modes
_OFFBOARD_ACTIONS = {
    3: FailsafeAction.RETURN,
    4: FailsafeAction.LAND,
    5: FailsafeAction.HOLD,
    6: FailsafeAction.TERMINATE,
    7: FailsafeAction.DISARM,
}
_OFFBOARD_MODES = {0: modes.POSITION, 1: modes.ALTITUDE, 2: modes.STABILIZED}
# COM_RCL_EXCEPT: bit mask -> modes that continue without a remote control
_RC_EXCEPTIONS = {1: (modes.MISSION,), 2: (modes.HOLD, modes.TAKEOFF), 4: (modes.OFFBOARD,)}
_LOGS = {-1: LogWhen.NEVER, 0: LogWhen.ARMED, 1: LogWhen.FROM_BOOT, 2: LogWhen.ALWAYS}


def _offboard_lost_action(params: Parameters) -> FailsafeAction:
    """Return the action after a lost offboard link, where no pilot can take over."""
    sticks_enabled = int(params["COM_RC_IN_MODE"]) != NO_STICKS
    without_pilot = FailsafeAction.RETURN if sticks_enabled else FailsafeAction.HOLD
    return _OFFBOARD_ACTIONS.get(int(params["COM_OBL_RC_ACT"]), without_pilot)


def _continuing_modes(params: Parameters) -> dict[int, FailsafeAction]:
    excepted = int(params["COM_RCL_EXCEPT"])
    return {n: FailsafeAction.NOTHING for bit, ns in _RC_EXCEPTIONS.items() if excepted & bit for n in ns}


def _positive_or_inf(value: float) -> float:
    return value if value > 0 else math.inf


def _positive(value: float) -> float:
    return max(value, MIN_SPEED_M_S)


def _battery(params: Parameters) -> fp.BatteryParameters:
    capacity_mah = params["BAT1_CAPACITY"]
    action = int(params["COM_LOW_BAT_ACT"])
    critical = _CRITICAL_ACTIONS.get(action, FailsafeAction.WARN)
    emergency = _EMERGENCY_ACTIONS.get(action, FailsafeAction.WARN)
    return fp.BatteryParameters(
        capacity_mah=capacity_mah if capacity_mah > 0 else DEFAULT_CAPACITY_MAH,
        full_v=max(int(params["BAT1_N_CELLS"]), 1) * params["BAT1_V_CHARGED"],
        levels=(
            fp.BatteryLevel("battery_warning", 0.0, params["BAT_LOW_THR"], FailsafeAction.WARN),
            fp.BatteryLevel("battery_low", 0.0, params["BAT_CRIT_THR"], critical),
            fp.BatteryLevel("battery_critical", 0.0, params["BAT_EMERGEN_THR"], emergency),
        ),
    )


def _returning(
    params: Parameters, speed_m_s: float, *, height_at: HeightAt | None = None, loiter_radius_m: float = 0.0
) -> fp.ReturnParameters:
    wait_s = params["RTL_LAND_DELAY"]
    return fp.ReturnParameters(
        height_m=params["RTL_RETURN_ALT"],
        speed_m_s=speed_m_s,
        wait_s=wait_s if wait_s >= 0 else math.inf,
        height_at=height_at,
        loiter_radius_m=loiter_radius_m,
        hover_height_m=params["RTL_DESCEND_ALT"],
    )


def _takeoff(
    params: Parameters,
    *,
    speed_m_s: float | None = None,
    slow_below_m: float = 0.0,
    straight: bool = False,
    reached_m: float | None = None,
) -> fp.TakeoffParameters:
    then = Behaviour.MISSION if params["COM_TAKEOFF_ACT"] == 1 else Behaviour.HOLD
    height_m = params["MIS_TAKEOFF_ALT"]
    return fp.TakeoffParameters(height_m, speed_m_s, slow_below_m, then, straight, reached_m)


def _flight_parameters(
    params: Parameters,
    limits: fp.Limits,
    takeoff: fp.TakeoffParameters,
    mission: fp.MissionParameters,
    returning: fp.ReturnParameters,
    landing: fp.LandingParameters,
    pilot: PilotLimits,
    following: Following | None = None,
) -> FlightParameters:
    """Add the records that do not depend on the airframe."""
    gcs_action = _LINK_ACTIONS.get(int(params["NAV_DLL_ACT"]), FailsafeAction.NOTHING)
    rc_action = _LINK_ACTIONS.get(int(params["NAV_RCL_ACT"]), FailsafeAction.NOTHING)
    fence_action = _FENCE_ACTIONS.get(int(params["GF_ACTION"]), FailsafeAction.WARN)
    delay_s = params["COM_FAIL_ACT_T"]
    return FlightParameters(
        limits=limits,
        takeoff=takeoff,
        mission=mission,
        returning=returning,
        landing=landing,
        pilot=pilot,
        battery=_battery(params),
        arming=fp.ArmingParameters(
            disarm_landed_s=_positive_or_inf(params["COM_DISARM_LAND"]),
            disarm_unflown_s=_positive_or_inf(params["COM_DISARM_PRFLT"]),
        ),
        gcs=fp.GcsParameters(
            sysid=None,
            timeout_s=math.inf if gcs_action is FailsafeAction.NOTHING else float(params["COM_DL_LOSS_T"]),
            action=fp.LinkAction(gcs_action),
            missing_is_lost=True,
        ),
        rc=fp.RcParameters(
            timeout_s=params["COM_RC_LOSS_T"],
            action=fp.LinkAction(rc_action, _continuing_modes(params)),
            lost_unarmed_counts=False,
            without_receiver=True,
        ),
        setpoints=fp.SetpointParameters(
            timeout_s=params["COM_OF_LOSS_T"],
            action=_offboard_lost_action(params),
            mode=None
            if int(params["COM_RC_IN_MODE"]) == NO_STICKS
            else _OFFBOARD_MODES.get(int(params["COM_OBL_RC_ACT"])),
            following=following,
        ),
        position=fp.PositionParameters(FailsafeAction.LAND),
        fence=fp.FenceParameters(
            enabled=fence_action is not FailsafeAction.NOTHING,
            action=fence_action,
            max_height_m=_positive_or_inf(params["GF_MAX_VER_DIST"]),
            radius_m=_positive_or_inf(params["GF_MAX_HOR_DIST"]),
        ),
        wind=(params["SIM_WIND_SPD"] if params["SIM_WIND_SPD"] > 0 else None, params["SIM_WIND_DIR"]),
        failsafe_delay_s=delay_s if delay_s > MAX_IGNORED_DELAY_S else 0.0,
        logs=_LOGS.get(int(params["SDLOG_MODE"]), LogWhen.ARMED),
    )


def _return_height(params: Parameters) -> HeightAt | None:
    """Return the function for the height of a return (`ReturnParameters.height_at`); None: no cone.

    The height is RTL_RETURN_ALT. Within RTL_MIN_DIST a cone limits the height, but not below twice the
    acceptance radius. Within that radius the height is twice the distance, so 0 at home.
    """
    full_m, cone_deg, radius_m = params["RTL_RETURN_ALT"], params["RTL_CONE_ANG"], params["NAV_ACC_RAD"]
    cone_within_m = params["RTL_MIN_DIST"]
    slope = 1 / math.tan(math.radians(min(max(cone_deg, 1.0), 89.0)))

    def return_height_m(distance_m: float, _height_m: float) -> float:
        if distance_m <= radius_m:
            return 2 * distance_m
        return max(min(full_m, slope * distance_m) if distance_m <= cone_within_m else full_m, 2 * radius_m)

    return return_height_m if cone_deg > 0 else None


def _following(params: Parameters) -> Following:
    """Return the position control of OFFBOARD (`PositionControl`), which limits the tilt, not the jerk."""
    tilt_rad = math.radians(min(max(params["MPC_TILTMAX_AIR"], 20.0), 89.0))
    return Following(
        horizontal=Gains(
            position_hz=max(params["MPC_XY_P"], 0.01),
            velocity_hz=max(params["MPC_XY_VEL_P_ACC"], 1.2),
            acceleration_m_s2=GRAVITY_M_S2 * math.tan(tilt_rad),
            lag_s=TILT_TIME_S,
        ),
        vertical=Gains(
            position_hz=max(params["MPC_Z_P"], 0.1),
            velocity_hz=max(params["MPC_Z_VEL_P_ACC"], 2.0),
            acceleration_m_s2=GRAVITY_M_S2,
        ),
        speed_m_s=_positive(params["MPC_XY_VEL_MAX"]),
        climb_m_s=_positive(params["MPC_Z_VEL_MAX_UP"]),
        descent_m_s=_positive(params["MPC_Z_VEL_MAX_DN"]),
        limits_total=True,
    )


def copter_flight_parameters(params: Parameters) -> FlightParameters:
    """Convert the multicopter's parameters."""
    cruise_m_s = _positive(min(params["MPC_XY_CRUISE"], params["MPC_XY_VEL_MAX"]))
    descent_m_s = _positive(min(params["MPC_Z_V_AUTO_DN"], params["MPC_Z_VEL_MAX_DN"]))
    vertical_acceleration_m_s2 = _positive(min(params["MPC_ACC_UP_MAX"], params["MPC_ACC_DOWN_MAX"]))
    return _flight_parameters(
        params,
        following=_following(params),
        limits=fp.Limits(
            speed_m_s=cruise_m_s,
            climb_m_s=_positive(min(params["MPC_Z_V_AUTO_UP"], params["MPC_Z_VEL_MAX_UP"])),
            descent_m_s=descent_m_s,
            acceleration_m_s2=_positive(params["MPC_ACC_HOR"]),
            autopilot_jerk_m_s3=_positive(params["MPC_JERK_AUTO"]),
            vertical_acceleration_m_s2=vertical_acceleration_m_s2,
            acceptance_radius_m=max(params["NAV_ACC_RAD"], 0.05),
            yaw_rate_deg_s=_positive(params["MPC_YAWRAUTO_MAX"]),
            lift_off_s=LIFT_OFF_S,
        ),
        takeoff=_takeoff(
            params,
            speed_m_s=_positive(params["MPC_TKO_SPEED"]),
            slow_below_m=params["MPC_LAND_ALT1"],
            reached_m=_positive(params["NAV_MC_ALT_RAD"]),
        ),
        mission=fp.MissionParameters(waypoint_height_m=_positive(params["NAV_MC_ALT_RAD"])),
        returning=_returning(params, cruise_m_s, height_at=_return_height(params)),
        landing=fp.LandingParameters(
            speed_m_s=_positive(params["MPC_LAND_SPEED"]),
            slow_below_m=params["MPC_LAND_ALT2"],
            speed_high_m_s=descent_m_s,
            slowing_below_m=params["MPC_LAND_ALT1"],
        ),
        pilot=PilotLimits(
            lean_deg=params["MPC_MAN_TILT_MAX"],
            yaw_rate_deg_s=params["MPC_MAN_Y_MAX"],
            climb_m_s=_positive(params["MPC_Z_VEL_MAX_UP"]),
            descent_m_s=descent_m_s,
            vertical_acceleration_m_s2=vertical_acceleration_m_s2,
            speed_m_s=_positive(min(params["MPC_VEL_MANUAL"], params["MPC_XY_VEL_MAX"])),
            acceleration_m_s2=_positive(params["MPC_ACC_HOR_MAX"]),
            throttle_deadzone=params["MPC_HOLD_DZ"] / 2,
            deadzone=params["MPC_HOLD_DZ"],
            expo=params["MPC_XY_MAN_EXPO"],
            idle_throttle=params["MPC_MANTHR_MIN"],
        ),
    )


def _switch_distance_m(params: Parameters) -> float:
    """Return the switch distance of a fixed wing before a waypoint (NPFG::switchDistance, cruise) [m]."""
    error_bound_m = params["NPFG_PERIOD"] * params["NPFG_DAMPING"] * params["FW_AIRSPD_TRIM"]
    return float(max(params["NAV_ACC_RAD"], params["NPFG_SW_DST_MLT"] * error_bound_m))


def plane_flight_parameters(params: Parameters) -> FlightParameters:
    """Convert the fixed wing's parameters."""
    cruise_m_s, sink_m_s = _positive(params["FW_AIRSPD_TRIM"]), _positive(params["FW_T_SINK_R_SP"])
    landing_m_s = params["FW_LND_AIRSPD"] if params["FW_LND_AIRSPD"] > 0 else params["FW_AIRSPD_MIN"]
    glide_m_s = _positive(landing_m_s * math.tan(math.radians(params["FW_LND_ANG"])))
    return _flight_parameters(
        params,
        limits=fp.Limits(
            speed_m_s=cruise_m_s,
            climb_m_s=_positive(params["FW_T_CLMB_MAX"]),
            descent_m_s=_positive(params["FW_T_SINK_MAX"]),
            acceleration_m_s2=3.0,
            vertical_acceleration_m_s2=3.0,
            acceptance_radius_m=_switch_distance_m(params),
            airspeed_min_m_s=_positive(params["FW_AIRSPD_MIN"]),
            airspeed_max_m_s=_positive(params["FW_AIRSPD_MAX"]),
            loiter_radius_m=params["NAV_LOITER_RAD"],
            bank_limit_deg=params["FW_R_LIM"],
            stall_m_s=params["FW_AIRSPD_STALL"],
        ),
        takeoff=_takeoff(params, straight=True),
        mission=fp.MissionParameters(
            items_set_radius=False, waypoint_height_m=params["NAV_FW_ALT_RAD"], circles_first=True
        ),
        returning=_returning(params, cruise_m_s, loiter_radius_m=params["RTL_LOITER_RAD"]),
        landing=fp.LandingParameters(speed_m_s=glide_m_s, slow_below_m=10.0, speed_high_m_s=sink_m_s),
        pilot=PilotLimits(
            lean_deg=params["FW_R_LIM"],
            climb_m_s=_positive(params["FW_T_CLMB_R_SP"]),
            descent_m_s=sink_m_s,
            pitch_up_deg=params["FW_P_LIM_MAX"],
            pitch_down_deg=-params["FW_P_LIM_MIN"],
        ),
    )
