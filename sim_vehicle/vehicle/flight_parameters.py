"""Flight parameters: the values of an autopilot's parameters in SI units, independent of parameter names."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from sim_vehicle.files.logs.record import LogWhen
from sim_vehicle.vehicle.behaviour import Behaviour


class FailsafeAction(Enum):
    """What a failsafe or a fence makes a vehicle do."""

    NOTHING = auto()
    WARN = auto()
    HOLD = auto()
    RETURN = auto()
    LAND = auto()
    TERMINATE = auto()
    DISARM = auto()
    RETURN_POINT = auto()  # guided to the fence's return point
    HOLD_ALTITUDE = auto()  # and no more than that: the position is lost
    MISSION = auto()
    GLIDE = auto()  # a plane, its motor off
    LEVEL = auto()  # a plane: straight on at the present altitude


class RallyAltitude(Enum):
    """What the altitude of a rally point is to a vehicle that returns there."""

    LEAST = auto()  # of the way there, as the height above home is
    EXACT = auto()  # it is flown to and circled at
    GROUND = auto()  # heights on the way and over it are counted from it, as they are from home


@dataclass(frozen=True, slots=True)
class FlightParameters:
    """What the parameters come to, in SI units; made anew by the personality after each change."""

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
    return_height_m: float  # above home, unless the vehicle is higher
    return_speed_m_s: float
    return_wait_s: float  # over home before it lands
    landing_speed_m_s: float
    landing_slow_below_m: float  # above home
    landing_speed_high_m_s: float
    pilot_descent_m_s: float
    # arming and starting
    arming_checks: bool
    mission_mode_armable: bool  # a ground station may arm in the mission's mode
    mission_takes_off: bool  # armed there, it takes off without being told to start
    mission_restarts: bool  # entering the mission's mode begins at the first item
    # disarming by itself; inf: never
    disarm_landed_s: float  # after a landing
    disarm_unflown_s: float  # after arming without a take-off
    # failsafes
    gcs_sysid: int | None  # whose heartbeats count; None: of any ground station
    gcs_timeout_s: float  # inf: not watched
    gcs_action: FailsafeAction
    battery_low_v: float  # 0: not watched
    battery_low_share: float  # of the capacity that is left; 0: not watched
    battery_low_action: FailsafeAction
    battery_critical_v: float
    battery_critical_share: float
    battery_critical_action: FailsafeAction
    battery_delay_s: float  # for so long the voltage has to be low
    rc_required: bool  # no RC is there: True makes that a failsafe
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
    fence_polygons: bool  # stored polygons and circles count
    fence_margin_m: float
    # copter
    begins_legs_at_rest: bool = False  # where another was broken off: it brakes first
    yaw_rate_deg_s: float = 60.0
    # plane
    airspeed_min_m_s: float = 0.0
    airspeed_max_m_s: float = 0.0
    loiter_radius_m: float = 0.0
    return_loiter_radius_m: float = 0.0  # over home; 0: the same
    bank_limit_deg: float = 0.0
    stall_m_s: float = 8.0  # airspeed in level flight
    fence_return_height_m: float = 0.0  # above home, at the fence's return point
    loiter_leaves_aligned: bool = False  # a circle to an altitude only toward the next place, told so or not
    return_lands: int = 0  # as the mission's nearest landing says; 1: once it circles over home, 2: at once
    waypoints_say_radius: bool = True  # how near to them is there; else it is waypoint_radius_m for all
    waypoint_height_m: float = math.inf  # at a waypoint more above or below that it circles until it is there
    circles_first: bool = False  # a circle to an altitude is flown to at the present one
    takeoff_along: bool = False  # straight to the place of the take-off until its altitude; else round about
    # environment by parameter (SIM_*)
    wind_m_s: float | None = None  # None: the scenario's
    wind_from_deg: float = 0.0
    # what only some autopilots have
    battery_warning_share: float | None = None  # of the capacity, below which it is said and no more
    failsafe_delay_s: float = 0.0  # in hold before a failsafe acts
    gcs_missed_unheard: bool = False  # a ground station that was never heard counts as lost
    # What a lost link leads to in the air in these modes, by number, in place of gcs_action and so on.
    gcs_action_in: Mapping[int, FailsafeAction] = field(default_factory=dict)
    rc_action_in: Mapping[int, FailsafeAction] = field(default_factory=dict)
    rc_short_action_in: Mapping[int, FailsafeAction] = field(default_factory=dict)
    rc_short_action: FailsafeAction | None = None  # as soon as it is lost; None: there is only rc_action
    rc_watched: bool = True
    rc_missed_unarmed: bool = True  # what is lost at arming already is a failsafe, too
    rc_timeout_s: float = 0.0  # without a frame, then it is lost
    rc_long_s: float = 0.0  # since the short action, or without a frame, until rc_action
    position_watched: bool = True
    position_lost_everywhere: bool = False  # acts in modes, too, that need no position
    pilot_missing: bool = False  # there is no manual control for the modes that need it
    takeoff_speed_m_s: float | None = None  # None: climb_m_s
    after_takeoff: Behaviour | None = None  # what follows the mode that takes off; None: it holds in it
    landing_slowing_below_m: float = (
        0.0  # above home; from here to landing_slow_below_m the descent slows evenly
    )
    return_hover_height_m: float | None = None  # above home, where it waits; None: at the height it came
    # above home, where it stays once it has waited, as long as the remote control is heard; None: it lands
    return_ends_m: float | None = None
    zero_keeps_altitude: bool = False  # 0 as the altitude of a mission item is the present one
    rally_limit_m: float = math.inf  # farther rally points do not count
    rally_altitude: RallyAltitude = RallyAltitude.GROUND
    rally_includes_home: bool = True  # home is returned to where it is nearer than any of them
    return_descends: bool = False  # to return_height_m, from above it too
    gcs_only: bool = False  # no other system than gcs_sysid is heard
    # distance from home, height above it [m] -> height to return at; None: return_height_m wherever it is
    return_height_at: Callable[[float, float], float] | None = None
    return_under_fence: bool = False  # no higher than the fence lets it
    fence_give_up_m: float = math.inf  # so far beyond a limit it lands, whatever the action
    logs: LogWhen = LogWhen.ARMED
