"""Which parameters of which firmware say what a configuration's policy declares. Pure.

Names, values and bits by the parameter lists of ArduCopter and ArduPlane 4.5 to 4.7
(https://ardupilot.org/copter/docs/parameters.html, https://ardupilot.org/plane/docs/parameters.html) and of
PX4 1.14 to 1.16 (https://docs.px4.io/main/en/advanced_config/parameter_reference), and by what reads them:
ArduCopter/events.cpp, mode_rtl.cpp, AC_Fence.cpp, AP_BattMonitor_Params.cpp; commander/failsafe/failsafe.cpp.
ArduPlane's RTL_ALTITUDE, AIRSPEED_CRUISE, AIRSPEED_MIN and ROLL_LIMIT_DEG have these names from 4.5 on
(before: ALT_HOLD_RTL, TRIM_ARSPD_CM, ARSPD_FBW_MIN, LIM_ROLL_CD; ArduPlane/Parameters.cpp converts them).
Who flies a firmware that no table is for, an older or a later one, does not know what it does when its link
is lost.

What a vehicle does without a remote control is not declared. ArduCopter does not arm without one while
FS_THR_ENABLE watches for it ("RC not found"); PX4 takes one that is missing at arming as not meant to be
there (NAV_RCL_ACT), and is never flown in OFFBOARD (COM_OBL_RC_ACT).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from swarmctl.agent.approach import Wings
from swarmctl.config_preflight import Policy
from swarmctl.core.returns import CLIMBS_TO_M
from swarmctl.mavlink.firmware import Firmware
from swarmctl.mavlink.parameters import equal

Version = tuple[int, int]


class NoTable(Exception):
    """Nobody knows which parameters of this firmware say what is declared, or none can."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What one parameter may be: one of `values`, from `least` to `most`, or without the bit number `bit`."""

    name: str
    declared: str
    """what it stands for"""
    set_to: float | None = None
    """what is written where it is another, the bit aside; None: a person sets it"""
    values: tuple[float, ...] = ()
    least: float = math.nan
    most: float = math.nan
    bit: int | None = None
    may_lack: bool = False
    """Some of these firmwares do not have it, and behave as is wanted: then it is not told."""

    def accepts(self, value: float) -> bool:
        if not math.isfinite(value):
            return False
        if self.bit is not None:
            return value.is_integer() and not int(value) >> self.bit & 1
        return any(equal(value, v) for v in self.values) or self.least <= value <= self.most

    def met_by(self, told: Mapping[str, float]) -> bool:
        """`told`: what the vehicle has told of those it was asked for, by name; empty where it was silent."""
        if self.name not in told:
            return self.may_lack and bool(told)
        return self.accepts(told[self.name])

    def corrected(self, value: float) -> float | None:
        """What to write in the place of `value`, which is not accepted; None: nothing."""
        if self.bit is None:
            return self.set_to
        return float(int(value) & ~(1 << self.bit)) if math.isfinite(value) else None

    def __str__(self) -> str:
        if self.bit is not None:
            return f"without bit {self.bit}"
        texts = [f"{v:g}" for v in self.values]
        if not math.isnan(self.least):
            above = "above 0" if self.least < 1.0 else f"{self.least:g} or more"
            texts.append(above if math.isinf(self.most) else f"{self.least:g} to {self.most:g}")
        return " or ".join(texts)


@dataclass(frozen=True, slots=True)
class Intent:
    """What the parameters of one vehicle are to say."""

    policy: Policy
    gcs_sysid: int
    """whose heartbeats it is to listen for"""
    altitude_m: float
    """it flies at, above home"""
    ceiling_m: float
    """above home"""
    wings: Wings | None = None
    """of what is planned for as a fixed wing"""
    speed_m_s: float = 15.0
    """it cruises so fast; a fixed wing through the air"""
    turn_radius_m: float = 40.0
    """of a fixed wing"""
    among_others: bool = False
    """it is one of a swarm, in which each flies at a height of its own"""

    @property
    def lost_link(self) -> str:
        return f"policy.lost_link: {self.policy.lost_link}"

    @property
    def lost_link_after(self) -> str:
        return f"policy.lost_link_after_s: {self.policy.lost_link_after_s}"

    @property
    def low_battery(self) -> str:
        return f"policy.low_battery: {self.policy.low_battery}"

    @property
    def fence_breach(self) -> str:
        return f"policy.fence_breach: {self.policy.fence_breach}"

    @property
    def returns_at_most_m(self) -> float:
        """Above home, unless it is higher already: turns are reckoned so, no fence is breached by it, and
        vehicles that all return by themselves at once do not climb to one height."""
        return min(CLIMBS_TO_M, self.ceiling_m, self.altitude_m if self.among_others else math.inf)

    @property
    def returns(self) -> str:
        return f"a return at {self.returns_at_most_m:g} m or below"

    @property
    def fence(self) -> str:
        return f"a fence up to {self.ceiling_m:g} m"


def parameters_for(firmware: Firmware, intent: Intent) -> tuple[Wanted, ...]:
    """Raises NoTable."""
    since, until, table = _TABLES.get(firmware.name, ((0, 0), (0, 0), None))
    if table is None or not since <= firmware.version <= until:
        known = (f"{name} {a[0]}.{a[1]} to {b[0]}.{b[1]}" for name, (a, b, _) in _TABLES.items())
        raise NoTable(f"no table for {firmware}; there is one for {', '.join(known)}")
    return table(intent, firmware.version)


def _one(name: str, declared: str, values: Mapping[str, tuple[float, ...]], action: str) -> Wanted:
    """An action by its numbers, of which the first is written."""
    if action not in values:
        raise NoTable(f"{name} has no value for {declared}; it can {', '.join(values)}")
    return Wanted(name, declared, values[action][0], values[action])


def _exactly(name: str, declared: str, value: float) -> Wanted:
    return Wanted(name, declared, value, (value,))


def _above_zero(name: str, declared: str) -> Wanted:
    return Wanted(name, declared, least=1e-6, most=math.inf)


def _ceiling(name: str, intent: Intent) -> Wanted:
    """High enough for the flight, and no higher than declared."""
    return Wanted(name, intent.fence, intent.ceiling_m, least=intent.altitude_m, most=intent.ceiling_m)


def _ardupilot_gcs(version: Version) -> str:
    return "MAV_GCS_SYSID" if version >= (4, 7) else "SYSID_MYGCS"


# 1 and 3, 2 and 3: also by the way it came (SmartRTL).
_COPTER_LOST_LINK = {"return": (1.0, 3.0), "land": (5.0,), "hold": (7.0,), "continue": (0.0,)}
_COPTER_BATTERY = {"return": (2.0, 3.0), "land": (1.0,)}
_COPTER_CRITICAL = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0)  # 5: Terminate
_COPTER_FENCE = {"return": (1.0, 3.0), "land": (2.0,), "hold": (4.0,)}
_GOES_ON_IN_AUTO = 1  # bit of FS_OPTIONS
_RETURNS_AT_M = 15.0  # RTL_ALT as it comes
_HEIGHT_AND_POLYGON = 5.0  # FENCE_TYPE; not the circle around home, which is nowhere declared


def _copter(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    policy = intent.policy
    return (
        _one("FS_GCS_ENABLE", intent.lost_link, _COPTER_LOST_LINK, policy.lost_link),
        *(
            (
                _exactly("FS_GCS_TIMEOUT", intent.lost_link_after, policy.lost_link_after_s),
                Wanted("FS_OPTIONS", intent.lost_link, bit=_GOES_ON_IN_AUTO),
                _exactly(_ardupilot_gcs(version), intent.lost_link, intent.gcs_sysid),
            )
            if policy.lost_link != "continue"
            else ()
        ),
        _one("BATT_FS_LOW_ACT", intent.low_battery, _COPTER_BATTERY, policy.low_battery),
        _critical(intent, _COPTER_CRITICAL),
        *_ardupilot_battery(intent),
        *_ardupilot_fence(intent),
        _one("FENCE_ACTION", intent.fence_breach, _COPTER_FENCE, policy.fence_breach),
        *_copter_return(intent, version),
    )


def _copter_return(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    """It climbs to RTL_ALT, and by RTL_CLIMB_MIN at least: in centimetres, and since 4.7 in metres."""
    suffix, unit_m = ("_M", 1.0) if version >= (4, 7) else ("", 0.01)
    most, usual = intent.returns_at_most_m / unit_m, _RETURNS_AT_M / unit_m
    return (
        Wanted(f"RTL_ALT{suffix}", intent.returns, min(usual, most), least=0.0, most=most),
        _exactly(f"RTL_CLIMB_MIN{suffix}", intent.returns, 0.0),
    )


_PRESENT_ALTITUDE = -1.0  # of RTL_ALTITUDE
_LANDS_ONCE_HOME = 1.0  # of RTL_AUTOLAND; with 0 and a landing in its mission it does not arm


_PLANE_CRITICAL = (0.0, 1.0, 2.0)  # 3: Terminate, 5: Parachute; 4, 6 and 7 are of a quadplane, or of 4.7


def _plane(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    policy, wings = intent.policy, intent.wings
    if wings is None:
        raise NoTable("it is a fixed wing and is planned for as what hovers; say `airframe: plane` of it")
    watched = policy.lost_link != "continue"
    return (
        _exactly("FS_GCS_ENABL", intent.lost_link, 1.0 if watched else 0.0),
        *(
            (
                _one("FS_LONG_ACTN", intent.lost_link, {"return": (1.0,)}, policy.lost_link),
                _exactly("FS_LONG_TIMEOUT", intent.lost_link_after, policy.lost_link_after_s),
                _exactly(_ardupilot_gcs(version), intent.lost_link, intent.gcs_sysid),
            )
            if watched
            else ()
        ),
        _one("BATT_FS_LOW_ACT", intent.low_battery, {"return": (1.0,), "land": (2.0,)}, policy.low_battery),
        _critical(intent, _PLANE_CRITICAL),
        *_ardupilot_battery(intent),
        *_ardupilot_fence(intent),
        _one("FENCE_ACTION", intent.fence_breach, {"return": (1.0,)}, policy.fence_breach),
        *_plane_circles(intent, wings),
        *_plane_flight(intent),
    )


def _plane_circles(intent: Intent, wings: Wings) -> tuple[Wanted, ...]:
    """It holds and returns in circles as wide as reckoned with, lands once it is home, and can fly slowly
    enough. The sign of a radius is the way round."""
    most_m, slowest_m_s = wings.loiter_radius_m, wings.min_speed_m_s
    radius = f"wings.loiter_radius_m: {most_m:g}"
    return (
        Wanted("WP_LOITER_RAD", radius, most_m, least=-most_m, most=most_m),
        Wanted("RTL_RADIUS", radius, 0.0, least=-most_m, most=most_m),
        _exactly("RTL_AUTOLAND", "a return that ends in a landing", _LANDS_ONCE_HOME),
        Wanted(
            "RTL_ALTITUDE",
            "a return at the height it flies at" if intent.among_others else intent.fence,
            _PRESENT_ALTITUDE,
            (_PRESENT_ALTITUDE,),
            # It comes down for this, too.
            least=intent.altitude_m if intent.among_others else wings.final_height_m,
            most=intent.altitude_m if intent.among_others else intent.ceiling_m,
        ),
        Wanted("AIRSPEED_MIN", f"wings.min_speed_m_s: {slowest_m_s:g}", least=0.0, most=slowest_m_s),
    )


_SPEED_OFF_M_S = 0.5
_G_M_S2 = 9.81


def _plane_flight(intent: Intent) -> tuple[Wanted, ...]:
    """It cruises as fast and banks as far as its turns are reckoned with, and flies past a waypoint that it
    cannot hit. WP_RADIUS says nothing: each waypoint of ours has a radius of its own (param2).

    A quadplane says that it is a fixed wing where Q_MAV_TYPE is 0 (`QuadPlane::get_mav_type`), and takes off,
    lands and holds in another way. How fast it is flown its owner decides.
    """
    return (
        *_cruise(intent, "AIRSPEED_CRUISE", "ROLL_LIMIT_DEG"),
        _exactly("WP_MAX_RADIUS", "no circling at a waypoint", 0.0),
        Wanted("Q_ENABLE", "airframe: plane", values=(0.0,)),
    )


def _cruise(intent: Intent, airspeed: str, bank_limit: str) -> tuple[Wanted, Wanted]:
    """By the names of these two: of [m/s] and of [deg]."""
    cruises, radius_m = _cruises(airspeed, intent), intent.turn_radius_m
    bank_deg = math.degrees(math.atan2(intent.speed_m_s**2, _G_M_S2 * radius_m))
    turns = f"turn_radius_m: {radius_m:g} at {cruises.declared}"
    return cruises, Wanted(bank_limit, turns, least=bank_deg, most=90.0)


def _cruises(name: str, intent: Intent) -> Wanted:
    """By the name of its speed [m/s], which its owner decides."""
    speed_m_s = intent.speed_m_s
    least, most = speed_m_s - _SPEED_OFF_M_S, speed_m_s + _SPEED_OFF_M_S
    return Wanted(name, f"speed_m_s: {speed_m_s:g}", least=least, most=most)


def _critical(intent: Intent, values: tuple[float, ...]) -> Wanted:
    """Where the battery is still lower it does no more, returns or lands: no motor stops in the air."""
    return Wanted("BATT_FS_CRT_ACT", intent.low_battery, 0.0, values)


def _ardupilot_battery(intent: Intent) -> tuple[Wanted, ...]:
    """There is a monitor, a voltage that counts as low, and a time after which it does, of which none is
    never: they depend on what is built in."""
    return tuple(
        _above_zero(name, intent.low_battery) for name in ("BATT_MONITOR", "BATT_LOW_VOLT", "BATT_LOW_TIMER")
    )


def _ardupilot_fence(intent: Intent) -> tuple[Wanted, ...]:
    return (
        _exactly("FENCE_ENABLE", intent.fence, 1.0),
        _exactly("FENCE_TYPE", intent.fence, _HEIGHT_AND_POLYGON),
        _ceiling("FENCE_ALT_MAX", intent),
    )


_PX4_LOST_LINK = {"return": (2.0,), "land": (3.0,), "hold": (1.0,), "continue": (0.0,)}
_PX4_BATTERY = {"return": (3.0,), "land": (2.0,)}
_PX4_FENCE = {"return": (3.0,), "land": (5.0,), "hold": (2.0,)}
_PX4_MISSION_EXCEPTED = 0  # bit of COM_DLL_EXCEPT, which came while 1.16 was made
_PX4_RETURNS_AT_M = 30.0  # RTL_RETURN_ALT as it comes
_STRAIGHT_HOME = 0.0  # of RTL_TYPE; the others may lead to the landing of the mission, which is at the goal
_MOST_DELAY_S = 300.0  # of RTL_LAND_DELAY; with -1 it stays in the air over home


def _px4(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    return (
        *_px4_link(intent, version, _PX4_LOST_LINK),
        _one("COM_LOW_BAT_ACT", intent.low_battery, _PX4_BATTERY, intent.policy.low_battery),
        _one("GF_ACTION", intent.fence_breach, _PX4_FENCE, intent.policy.fence_breach),
        *_px4_heights(intent),
        _exactly("RTL_TYPE", "a return to where it took off", _STRAIGHT_HOME),
        Wanted("RTL_LAND_DELAY", "a return that ends in a landing", 0.0, least=0.0, most=_MOST_DELAY_S),
        # As it comes it flies its mission at half the speed that is reckoned with where nobody says.
        _cruises("MPC_XY_CRUISE", intent),
    )


# AUTO.LAND of a fixed wing comes down in a circle wherever it is, and what it would hold outside of its fence
# is a circle too: neither may be declared.
_PX4_PLANE_LOST_LINK = {"return": (2.0,), "hold": (1.0,), "continue": (0.0,)}
_TO_THE_MISSIONS_LANDING = 1.0  # of RTL_TYPE
_LEAST_RADIUS_M = 1.0
_WITHOUT_TERRAIN = 0  # bit of FW_LND_ABORT, set as it comes: it breaks off and circles over the touch-down
_STEEPER_DEG = 0.5  # than the slope that is reckoned with, so that roundings do not count
_ALTITUDE_OFF_M = 10.0  # NAV_FW_ALT_RAD as it comes


def _px4_plane(intent: Intent, version: Version) -> tuple[Wanted, ...]:
    policy, wings = intent.policy, intent.wings
    if wings is None:
        raise NoTable("it is a fixed wing and is planned for as what hovers; say `airframe: plane` of it")
    return (
        *_px4_link(intent, version, _PX4_PLANE_LOST_LINK),
        _one("COM_LOW_BAT_ACT", intent.low_battery, {"return": (3.0,)}, policy.low_battery),
        _one("GF_ACTION", intent.fence_breach, {"return": (3.0,)}, policy.fence_breach),
        *_px4_heights(intent),
        *_px4_circles(intent, wings),
        *_cruise(intent, "FW_AIRSPD_TRIM", "FW_R_LIM"),
    )


def _px4_circles(intent: Intent, wings: Wings) -> tuple[Wanted, ...]:
    """It returns to the landing of its mission, holds in circles as wide as reckoned with, may come down that
    slope, climbs on its way and not in a circle at its first waypoint, and can fly slowly enough."""
    most_m, slowest_m_s = wings.loiter_radius_m, wings.min_speed_m_s
    steep_deg = wings.glide_from_circle_deg
    climbs_m = max(intent.altitude_m - wings.takeoff_height_m, _ALTITUDE_OFF_M)
    return (
        _exactly("RTL_TYPE", "a return that ends in a landing", _TO_THE_MISSIONS_LANDING),
        Wanted(
            "NAV_LOITER_RAD",
            f"wings.loiter_radius_m: {most_m:g}",
            most_m,
            least=_LEAST_RADIUS_M,
            most=most_m,
        ),
        Wanted(
            "FW_LND_ANG",
            f"a landing as wings says, {steep_deg:.1f} degrees steep",
            float(math.ceil(steep_deg + _STEEPER_DEG)),
            least=steep_deg,
            most=90.0,
        ),
        Wanted("FW_LND_ABORT", "a landing that needs no range finder", bit=_WITHOUT_TERRAIN),
        Wanted("NAV_ACC_RAD", "no turn that is begun earlier", least=0.0, most=intent.turn_radius_m),
        Wanted("NAV_FW_ALT_RAD", "a climb on its way", climbs_m, least=climbs_m, most=math.inf),
        Wanted("FW_AIRSPD_MIN", f"wings.min_speed_m_s: {slowest_m_s:g}", least=0.0, most=slowest_m_s),
    )


def _px4_link(
    intent: Intent, version: Version, actions: Mapping[str, tuple[float, ...]]
) -> tuple[Wanted, ...]:
    policy = intent.policy
    watched = policy.lost_link != "continue"
    return (
        _one("NAV_DLL_ACT", intent.lost_link, actions, policy.lost_link),
        *((_exactly("COM_DL_LOSS_T", intent.lost_link_after, policy.lost_link_after_s),) if watched else ()),
        *(
            (Wanted("COM_DLL_EXCEPT", intent.lost_link, bit=_PX4_MISSION_EXCEPTED, may_lack=True),)
            if watched and version >= (1, 16)
            else ()
        ),
    )


def _px4_heights(intent: Intent) -> tuple[Wanted, ...]:
    return (
        _ceiling("GF_MAX_VER_DIST", intent),
        _exactly("GF_MAX_HOR_DIST", intent.fence, 0.0),
        Wanted(
            "RTL_RETURN_ALT",
            intent.returns,
            min(_PX4_RETURNS_AT_M, intent.returns_at_most_m),
            least=0.0,
            most=intent.returns_at_most_m,
        ),
    )


_TABLES: Mapping[str, tuple[Version, Version, Callable[[Intent, Version], tuple[Wanted, ...]]]] = {
    "ArduCopter": ((4, 5), (4, 7), _copter),
    "ArduPlane": ((4, 5), (4, 7), _plane),
    "PX4": ((1, 14), (1, 16), _px4),
    "PX4 plane": ((1, 14), (1, 16), _px4_plane),
}
"""from which version to which; what a later one has renamed nobody knows"""
