"""Flight parameters: the values of an autopilot's parameters, with the same names for all autopilots.

Each record belongs to one part of the vehicle, named after the colon of the record's docstring.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from sim_vehicle.files.logs.record import LogWhen
from sim_vehicle.physics.following import Following
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


@dataclass(frozen=True)
class Limits:
    """Limits of the airframe: `Body.limit`, with the same names."""

    speed_m_s: float
    climb_m_s: float
    descent_m_s: float
    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    acceptance_radius_m: float
    autopilot_jerk_m_s3: float = math.inf  # of a copter that speeds up to a position
    yaw_rate_deg_s: float = 60.0  # of a copter
    lift_off_s: float = 0.0  # least time from arming to the lift-off of a copter
    # of a plane
    airspeed_min_m_s: float = 0.0
    airspeed_max_m_s: float = 0.0
    loiter_radius_m: float = 0.0
    bank_limit_deg: float = 0.0
    stall_m_s: float = 8.0  # airspeed in level flight


@dataclass(frozen=True, slots=True)
class BatteryLevel:
    """A level of the battery that is worse than normal: `battery_watch`."""

    event: str
    below_v: float  # 0: not watched
    below_share: float  # of the capacity; 0: not watched
    action: FailsafeAction


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """The battery and its failsafe: `battery_watch`."""

    capacity_mah: float
    full_v: float
    levels: tuple[BatteryLevel, ...]  # warning (some autopilots only), low, critical
    delay_s: float = 0.0  # duration of a low voltage before the action


@dataclass(frozen=True, slots=True)
class ArmingParameters:
    """Arming and automatic disarming: `arming`."""

    checks: bool = True
    in_mission_mode: bool = True  # arming is possible in the mission mode
    disarm_landed_s: float = math.inf  # after a landing; inf: never
    disarm_unflown_s: float = math.inf  # after arming without a take-off; inf: never


@dataclass(frozen=True, slots=True)
class TakeoffParameters:
    """Take-off: `flight` and `mission_pilot`."""

    height_m: float
    speed_m_s: float | None = None  # near the ground; None: the climb speed of the limits
    slow_below_m: float = 0.0  # height above home below which `speed_m_s` holds
    then: Behaviour | None = None  # behaviour after the climb; None: hold in the take-off mode
    straight: bool = False  # a plane climbs straight towards the take-off position; else in circles
    reached_m: float | None = None  # height left where the climb ends; None: the acceptance radius


@dataclass(frozen=True, slots=True)
class ReturnParameters:
    """Return to launch: `manoeuvres.Return`."""

    height_m: float  # above home; a higher vehicle descends only with `descends`
    speed_m_s: float
    wait_s: float  # over home before the landing
    # (distance from the destination, height above it) [m] -> return height [m]; None: height_m
    height_at: Callable[[float, float], float] | None = None
    descends: bool = False  # descends to height_m from above
    under_fence: bool = False  # limited by the fence's maximum altitude
    loiter_radius_m: float = 0.0  # of a plane over home; 0: the radius of the limits
    hover_height_m: float | None = None  # of the wait, above the destination; None: travel height
    final_height_m: float | None = None  # above home at the end, with remote control; None: landing
    lands: int = 0  # use of the mission's landing; 0: never, 1: over home, 2: at once


@dataclass(frozen=True, slots=True)
class RallyParameters:
    """Rally points: `home_and_rally`."""

    limit_m: float = math.inf  # farther rally points are ignored
    altitude: RallyAltitude = RallyAltitude.GROUND
    includes_home: bool = True  # home replaces rally points that are farther away


@dataclass(frozen=True, slots=True)
class LandingParameters:
    """Speeds of a landing by height above home: `flight`."""

    speed_m_s: float  # below slow_below_m
    slow_below_m: float
    speed_high_m_s: float  # at greater heights
    slowing_below_m: float = 0.0  # from this height down to slow_below_m the descent slows evenly

    def speed_at(self, height_m: float) -> float:
        """Return the descent speed at a height above home [m/s]."""
        if height_m < self.slow_below_m:
            return self.speed_m_s
        if height_m < self.slowing_below_m:
            share = (height_m - self.slow_below_m) / (self.slowing_below_m - self.slow_below_m)
            return self.speed_m_s + share * (self.speed_high_m_s - self.speed_m_s)
        return self.speed_high_m_s

    def steady_s(self, height_m: float) -> float:
        """Return the time until a descent from a height above home slows down [s]; inf: it does not."""
        if height_m < self.slow_below_m:
            return math.inf
        steady_m = height_m - max(self.slow_below_m, self.slowing_below_m)
        return max(steady_m / self.speed_high_m_s, 0.0)


@dataclass(frozen=True, slots=True)
class MissionParameters:
    """Flight of a mission: `mission_pilot`."""

    takes_off: bool = True  # arming in the mission mode starts the take-off
    restarts: bool = False  # entering the mission mode begins at the first item
    begins_legs_at_rest: bool = False  # the vehicle brakes after an interrupted leg
    leg_jerk_m_s3: float = math.inf  # of a copter on a leg of a mission or a return (`Body.fly_to`)
    items_set_radius: bool = True  # an item of a plane can set its acceptance radius
    zero_keeps_altitude: bool = False  # altitude 0 of an item is the present altitude
    loiter_leaves_aligned: bool = False  # a circle to an altitude ends only toward the next position
    circles_first: bool = False  # flies to a circle at the present altitude, then changes altitude
    # Altitude tolerance at a waypoint. A plane outside of it circles to the altitude; a mission of PX4 begins
    # with a climb to a first item above it.
    waypoint_height_m: float = math.inf


@dataclass(frozen=True, slots=True)
class LinkAction:
    """Action after the loss of a link: `failsafe`."""

    normal: FailsafeAction
    by_mode: Mapping[int, FailsafeAction] = field(default_factory=dict)  # in the air, by mode number


@dataclass(frozen=True, slots=True)
class GcsParameters:
    """The ground station and its failsafe: `failsafe`."""

    sysid: int | None  # source of the heartbeats that count; None: any ground station
    timeout_s: float  # inf: not watched
    action: LinkAction
    only: bool = False  # the vehicle ignores messages of other systems
    missing_is_lost: bool = False  # a ground station without a heartbeat since the boot counts as lost


@dataclass(frozen=True, slots=True)
class RcParameters:
    """The remote control and its failsafe: `remote_watch`."""

    timeout_s: float  # time without a frame until the loss
    action: LinkAction
    short_action: LinkAction | None = None  # before `action`; None: only `action`
    long_s: float = 0.0  # from the short action (without one: from the last RC frame) to `action`
    watched: bool = True
    failed: bool = False  # a parameter (SIM_RC_FAIL) ends the RC link
    lost_unarmed_counts: bool = True  # a loss before arming counts
    without_receiver: bool = False  # frames come from ground stations only


@dataclass(frozen=True, slots=True)
class SetpointParameters:
    """Lost set-points, and the flight by set-points: `setpoints`."""

    timeout_s: float
    action: FailsafeAction
    mode: int | None = None  # custom_mode instead of the action; of a plane only if a pilot has the sticks
    following: Following | None = None  # None: a plane


@dataclass(frozen=True, slots=True)
class PositionParameters:
    """A lost position: `failsafe`."""

    lost_action: FailsafeAction
    watched: bool = True
    lost_everywhere: bool = False  # acts also in modes that need no position


@dataclass(frozen=True, slots=True)
class FenceParameters:
    """The fence around home; heights are above home: `fence_watch`."""

    enabled: bool
    action: FailsafeAction
    max_height_m: float = math.inf
    min_height_m: float = -math.inf  # once reached
    radius_m: float = math.inf
    polygons: bool = True  # stored polygons and circles are enforced
    margin_m: float = 0.0
    return_height_m: float = 0.0  # at the fence's return point
    give_up_m: float = math.inf  # distance beyond a limit at which the vehicle lands instead of the action


@dataclass(frozen=True, slots=True)
class FlightParameters:
    """Flight parameters; the personality derives new flight parameters after each parameter change."""

    limits: Limits
    battery: BatteryParameters
    takeoff: TakeoffParameters
    returning: ReturnParameters
    landing: LandingParameters
    pilot: PilotLimits
    gcs: GcsParameters
    rc: RcParameters
    setpoints: SetpointParameters
    position: PositionParameters
    fence: FenceParameters
    arming: ArmingParameters = ArmingParameters()
    mission: MissionParameters = MissionParameters()
    rally: RallyParameters = RallyParameters()
    wind: tuple[float | None, float] = (None, 0.0)  # see `Body.set_wind`
    failsafe_delay_s: float = 0.0  # hold before a return or landing by a failsafe
    logs: LogWhen = LogWhen.ARMED  # when to record logs
