"""The shape of a personality: what differs between autopilots, as data where it can be.

The rest of the package knows no parameter by name: a personality reads its own parameters, in the autopilot's
units, into a `Tuning` in SI units, and that is what a vehicle flies by.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import TYPE_CHECKING, Any

from sim_vehicle.files.logs.record import LogWhen
from sim_vehicle.files.logs.recorder import LogLimits
from sim_vehicle.vehicle.mission import Item, Mission

if TYPE_CHECKING:
    from sim_vehicle.vehicle.autopilot import Autopilot
    from sim_vehicle.vehicle.commands import Command
    from sim_vehicle.vehicle.params import Parameters

CommandHandler = Callable[["Autopilot", "Command", float], int]


class Behaviour(Enum):
    """What a vehicle does in a mode when nobody holds a stick."""

    MISSION = auto()
    GUIDED = auto()  # goes where it is told, else holds; obeys set-points
    HOLD = auto()  # stops and holds (a plane circles)
    TAKEOFF = auto()  # climbs to the take-off altitude, then what the personality says comes after
    RETURN = auto()
    LAND = auto()
    SINK = auto()  # the throttle stick reads its minimum: down at the pilot's descent rate
    CRUISE = auto()  # a plane: straight on at the present altitude
    DROP = auto()  # the same without altitude control (a plane glides)


@dataclass(frozen=True, slots=True)
class Mode:
    """One flight mode: its wire number (custom_mode) and what matters about it from outside."""

    number: int
    name: str
    behaviour: Behaviour
    armable: bool = False  # by a ground station
    needs_position: bool = True
    base_mode: int = 0  # MAV_MODE_FLAG bits beside CUSTOM_MODE_ENABLED and SAFETY_ARMED
    setpoints_only: bool = False  # may be entered, and stays, only while set-points stream in (OFFBOARD)
    selectable: bool = True  # by a ground station
    standard: int = 0  # MAV_STANDARD_MODE
    needs_pilot: bool = False  # cannot run armed without manual control (see Tuning.pilot_missing)
    terminates: bool = False  # the flight is over; only a reboot leaves it


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
class Tuning:
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


@dataclass(frozen=True, slots=True)
class Personality:
    """One autopilot's data for one kind of airframe; times in s, versions as on the wire."""

    name: str
    autopilot: int  # MAV_AUTOPILOT
    vehicle_type: int  # MAV_TYPE
    plane: bool
    modes: Mapping[int, Mode]
    boot_mode: int
    boot_text: tuple[bytes, ...]  # plain bytes on the link at each boot
    flight_sw_version: int
    capabilities: int
    parameters: Mapping[str, float | int]  # an int is an integer parameter, on the wire too
    read_only_parameters: frozenset[str]
    parameters_byte_wise: bool  # integers travel as their bytes (PX4), else as floats (ArduPilot)
    system_id_parameter: str
    tuning: Callable[["Parameters"], Tuning]
    commands: Mapping[int, CommandHandler]  # in place of, or beside, the common ones
    arm_refused: int  # MAV_RESULT
    disarm_refused: int  # MAV_RESULT in flight
    hears: Callable[[int, Any], bool]  # own system id, a message to that or to all: whether it is taken
    acknowledges_set_mode: bool  # the SET_MODE message
    home_item: bool  # item 0 of a mission is home
    empty_mission_total: int  # MISSION_CURRENT.total with no mission
    tells_mission_state: bool  # else mission_state is 0 always
    texts: Mapping[
        str, tuple[int, str]
    ]  # what is said when: key -> (MAV_SEVERITY, template); others are silent
    streams: Mapping[int, tuple[int, ...]]  # MAV_DATA_STREAM -> message ids
    default_rates_hz: Mapping[int, float]  # message id -> rate that flows without being asked for
    lacks: frozenset[int]  # messages of telemetry.STREAMS that this autopilot does not send
    singles: Mapping[int, Callable[["Autopilot", float], Sequence[Any]]]  # more that can be requested
    store_item: Callable[[Item], Item | int]  # kept item, or MAV_MISSION_RESULT
    max_mission_items: int
    transfer: Callable[["Autopilot"], Any]  # the vehicle's side of the mission protocol
    refusals: Callable[["Autopilot", float], list[str]]  # why it would not arm now
    ready_s: float  # from boot to a position estimate
    storage: Callable[["Autopilot", LogLimits], Any]  # its logs and files
    banner: tuple[str, ...]  # its name and version first
    aims: Callable[["Autopilot"], tuple[bool, bool]]  # whether its mode has a global and a local target
    # what only one of them does
    parameter_bits: Mapping[str, int] = field(default_factory=dict)  # of integers, where these are not 32
    mission: Callable[["Autopilot"], Mission] | None = None  # None: the one with home as item 0
    mission_ends_in: Behaviour | None = None  # the mode that follows a mission in the air
    rereads_mode_switch: bool = True  # soon after a boot, which undoes a mode set before
    active_when_armed: bool = False  # MAV_STATE of an armed vehicle on the ground
    fence_limits_latch: bool = False  # which of them count is taken up when the fence is enabled, not later
    force_arms: bool = True  # a forced arming by a ground station skips the checks, but for `mandatory`
    mandatory: Callable[["Autopilot", float], list[str]] = lambda _vehicle, _now: []  # as `refusals`
    landing_disarms: bool = True  # at once; else after Tuning.disarm_landed_s
    lands_amid_mission: bool = False  # and stays armed then, for what comes next
    signs: bool = False  # knows MAVLink 2 signing; else signatures are not looked at
    disarm_restores_mode: bool = False  # the last mode that may be armed in follows a flight
    answers_ping: bool = False  # PING to nobody in particular
    home_is_local: bool = False  # HOME_POSITION has local coordinates, too
    home_with_position: bool = False  # set once the position estimate is there, not before
    origin_moves: bool = False  # wherever SET_GPS_GLOBAL_ORIGIN says; else only while there is none
    flight_counter: str | None = None  # the parameter that a disarming counts up
    failsafe_disarms: bool = False  # one that would act in the air stops the motors on the ground
    failsafe_modes: Mapping[FailsafeAction, int] = field(default_factory=dict)  # where Behaviour does not say
    start_landing: Callable[["Autopilot", float], bool] | None = None  # where no mode lands; False: it cannot
    # What of the mission is flown in the mode that returns, and above which altitude [m above mean sea level]
    # that is begun; None: it returns to home or a rally point.
    return_by_mission: "Callable[[Autopilot], tuple[Sequence[Item], float] | None]" = lambda _vehicle: None
    battery_latches: bool = False  # is looked at while armed only, and a level stays until the next boot
    body_yaw_relative: bool = False  # a set-point's yaw in a frame of the body; else it is from north
    gps_fix_type: int = 6  # GPS_FIX_TYPE that its own simulator reports
    gps_present_in_use: bool = False  # SYS_STATUS calls it present while the estimator uses it; else always

    def mode_of(self, behaviour: Behaviour) -> Mode:
        """The mode in which a vehicle does this by itself; KeyError where there is none."""
        mode = self.find_mode(behaviour)
        if mode is None:
            raise KeyError(behaviour)
        return mode

    def find_mode(self, behaviour: Behaviour) -> Mode | None:
        """The mode in which a vehicle does this by itself, if there is one."""
        for mode in self.modes.values():
            asks = mode.setpoints_only or mode.needs_pilot or not mode.selectable
            if mode.behaviour is behaviour and not asks:
                return mode
        return None
