"""Flight parameters: the values of an autopilot's parameters, with the same names for all autopilots."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from sim_vehicle.files.logs.record import LogWhen
from sim_vehicle.vehicle.behaviour import Behaviour
from sim_vehicle.vehicle.sticks import PilotLimits


class FailsafeAction(Enum):
    """Action of a failsafe or of the fence."""

    NOTHING = auto()
    WARN = auto()
    HOLD = auto()
    RETURN = auto()
    LAND = auto()
    TERMINATE = auto()
    DISARM = auto()
    RETURN_POINT = auto()  # guided flight to the fence's return point
    HOLD_ALTITUDE = auto()  # altitude only, without a position
    MISSION = auto()
    GLIDE = auto()  # a plane without its motor
    LEVEL = auto()  # a plane: straight on at the present altitude


class RallyAltitude(Enum):
    """Meaning of a rally point's altitude for a vehicle that returns there."""

    MINIMUM = auto()  # lowest travel altitude; the return height above home still applies
    EXACT = auto()  # travel altitude
    GROUND = auto()  # reference of the return height, in place of home's altitude


@dataclass(frozen=True, slots=True)
class FlightParameters:
    """Flight parameters; the personality derives new flight parameters after each parameter change."""

    # airframe limits
    speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    waypoint_radius_m: float
    # battery
    capacity_mah: float
    full_v: float
    # take-off, return, landing
    takeoff_height_m: float
    return_height_m: float  # above home; a higher vehicle descends only with return_descends
    return_speed_m_s: float
    return_wait_s: float  # over home before the landing
    landing_speed_m_s: float  # below landing_slow_below_m
    landing_slow_below_m: float  # above home
    landing_speed_high_m_s: float  # at greater heights
    # arming and starting
    arming_checks: bool
    mission_mode_armable: bool  # arming is possible in the mission mode
    mission_takes_off: bool  # arming in the mission mode starts the take-off
    mission_restarts: bool  # entering the mission mode begins at the first item
    # automatic disarming; inf: never
    disarm_landed_s: float  # after a landing
    disarm_unflown_s: float  # after arming without a take-off
    # failsafes
    gcs_sysid: int | None  # source of the heartbeats that count; None: any ground station
    gcs_timeout_s: float  # inf: not watched
    gcs_action: FailsafeAction
    battery_low_v: float  # 0: not watched
    battery_low_share: float  # of the capacity; 0: not watched
    battery_low_action: FailsafeAction
    battery_critical_v: float
    battery_critical_share: float
    battery_critical_action: FailsafeAction
    battery_delay_s: float  # duration of a low voltage before the action
    rc_failed: bool  # a parameter (SIM_RC_FAIL) ends the RC link
    rc_action: FailsafeAction
    setpoint_timeout_s: float
    setpoint_action: FailsafeAction
    position_lost_action: FailsafeAction
    # fence
    fence_enabled: bool
    fence_action: FailsafeAction
    fence_max_height_m: float  # above home; inf: none
    fence_min_height_m: float  # above home, once reached; -inf: none
    fence_radius_m: float  # around home; inf: none
    fence_polygons: bool  # stored polygons and circles are enforced
    fence_margin_m: float
    # copter
    begins_legs_at_rest: bool = False  # the vehicle brakes after an interrupted leg
    yaw_rate_deg_s: float = 60.0
    # plane
    airspeed_min_m_s: float = 0.0
    airspeed_max_m_s: float = 0.0
    loiter_radius_m: float = 0.0
    return_loiter_radius_m: float = 0.0  # over home; 0: loiter_radius_m
    bank_limit_deg: float = 0.0
    stall_m_s: float = 8.0  # airspeed in level flight
    fence_return_height_m: float = 0.0  # above home, at the fence's return point
    loiter_leaves_aligned: bool = False  # a circle to an altitude ends only toward the next position
    return_lands: int = 0  # use of the mission's landing in a return; 0: never, 1: over home, 2: at once
    waypoints_set_radius: bool = True  # an item can set its acceptance radius; else waypoint_radius_m
    # Altitude tolerance at a waypoint. A plane outside of it circles to the altitude; a mission of PX4 begins
    # with a climb to a first item above it.
    waypoint_height_m: float = math.inf
    circles_first: bool = False  # flies to a circle at the present altitude, then changes altitude
    takeoff_straight: bool = False  # climbs straight towards the take-off position; else in circles
    # environment by parameter (SIM_*)
    wind_m_s: float | None = None  # None: the scenario's wind
    wind_from_deg: float = 0.0
    # parameters of some autopilots only
    battery_warning_share: float | None = None  # share of the capacity at which a warning is sent
    failsafe_delay_s: float = 0.0  # hold before a return or landing by a failsafe
    gcs_missing_is_lost: bool = False  # a ground station without a heartbeat since the boot counts as lost
    # Actions in the air by mode number, instead of gcs_action, rc_action and rc_short_action.
    gcs_action_in: Mapping[int, FailsafeAction] = field(default_factory=dict)
    rc_action_in: Mapping[int, FailsafeAction] = field(default_factory=dict)
    rc_short_action_in: Mapping[int, FailsafeAction] = field(default_factory=dict)
    rc_short_action: FailsafeAction | None = None  # action before rc_action; None: only rc_action
    rc_watched: bool = True
    rc_lost_unarmed_counts: bool = True  # a loss before arming counts
    rc_without_receiver: bool = False  # frames come from ground stations only
    rc_timeout_s: float = 0.0  # time without a frame until the loss
    rc_long_s: float = 0.0  # from the short action (without one: from the last RC frame) to rc_action
    position_watched: bool = True
    position_lost_everywhere: bool = False  # acts also in modes that need no position
    pilot: PilotLimits = field(default_factory=PilotLimits)
    setpoint_mode: int | None = None  # custom_mode after lost set-points, if a pilot has the sticks
    takeoff_speed_m_s: float | None = None  # None: climb_m_s
    after_takeoff: Behaviour | None = None  # behaviour after the climb; None: hold in the take-off mode
    # Above home; from this height down to landing_slow_below_m the descent slows evenly.
    landing_slowing_below_m: float = 0.0
    return_hover_height_m: float | None = None  # of the wait, above the destination; None: travel height
    # Height above home at the end of a return, with remote control; None: landing.
    return_final_height_m: float | None = None
    zero_keeps_altitude: bool = False  # altitude 0 of a mission item is the present altitude
    rally_limit_m: float = math.inf  # farther rally points are ignored
    rally_altitude: RallyAltitude = RallyAltitude.GROUND
    rally_includes_home: bool = True  # home replaces rally points that are farther away
    return_descends: bool = False  # descends to return_height_m from above
    gcs_only: bool = False  # the vehicle ignores messages of systems other than gcs_sysid
    # (distance from the destination, height above it) [m] -> return height [m]; None: return_height_m.
    return_height_at: Callable[[float, float], float] | None = None
    return_under_fence: bool = False  # limited by the fence's maximum altitude
    # distance beyond a limit at which the vehicle lands instead of the fence action
    fence_give_up_m: float = math.inf
    logs: LogWhen = LogWhen.ARMED  # when to record logs
