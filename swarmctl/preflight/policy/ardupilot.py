"""The tables of ArduCopter and ArduPlane, but for how a copter flies. Pure."""

from __future__ import annotations

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.preflight.policy import copter_flight
from swarmctl.preflight.policy.behaviour import DeclaredBehaviour, ceiling, cruise
from swarmctl.preflight.policy.required import (
    NoParameterTable,
    RequiredParameter,
    Version,
    above_zero,
    exactly,
    one,
)


def _gcs(version: Version) -> str:
    return "MAV_GCS_SYSID" if version >= (4, 7) else "SYSID_MYGCS"


# 1 and 3, 2 and 3: also by the way it came (SmartRTL).
_COPTER_LOST_LINK = {"return": (1.0, 3.0), "land": (5.0,), "hold": (7.0,), "continue": (0.0,)}
_COPTER_BATTERY = {"return": (2.0, 3.0), "land": (1.0,)}
_COPTER_CRITICAL = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0)  # 5: Terminate
_COPTER_FENCE = {"return": (1.0, 3.0), "land": (2.0,), "hold": (4.0,)}
_GOES_ON_IN_AUTO = 1  # bit of FS_OPTIONS
_HEIGHT_AND_POLYGON = 5.0  # FENCE_TYPE; not the circle around home, which is nowhere declared


def copter(intent: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    policy = intent.policy
    return (
        one("FS_GCS_ENABLE", intent.lost_link, _COPTER_LOST_LINK, policy.lost_link),
        *(
            (
                exactly("FS_GCS_TIMEOUT", intent.lost_link_after, policy.lost_link_after_s),
                RequiredParameter("FS_OPTIONS", intent.lost_link, bit=_GOES_ON_IN_AUTO),
                exactly(_gcs(version), intent.lost_link, intent.gcs_sysid),
            )
            if policy.lost_link != "continue"
            else ()
        ),
        one("BATT_FS_LOW_ACT", intent.low_battery, _COPTER_BATTERY, policy.low_battery),
        _critical(intent, _COPTER_CRITICAL),
        *_battery(intent),
        *_fence(intent),
        one("FENCE_ACTION", intent.fence_breach, _COPTER_FENCE, policy.fence_breach),
        *_copter_lost(),
        *copter_flight.returns(intent, version),
        *copter_flight.flight(intent, version),
    )


_LANDS = 1.0  # of FS_EKF_ACTION, and 3 from all modes; 2 holds a height by a pilot's stick, 0 only tells
_TRUSTS_UP_TO = 1.0  # of FS_EKF_THRESH, at most; with 0 nobody looks


def _copter_lost() -> tuple[RequiredParameter, ...]:
    """It lands where it does not know any more where it is."""
    declared = "a landing where it does not know where it is"
    return (
        RequiredParameter("FS_EKF_ACTION", declared, _LANDS, (_LANDS, 3.0)),
        RequiredParameter("FS_EKF_THRESH", declared, 0.8, least=0.1, most=_TRUSTS_UP_TO),
    )


_PRESENT_ALTITUDE = -1.0  # of RTL_ALTITUDE
_LANDS_ONCE_HOME = 1.0  # of RTL_AUTOLAND; with 0 and a landing in its mission it does not arm


_PLANE_CRITICAL = (0.0, 1.0, 2.0)  # 3: Terminate, 5: Parachute; 4, 6 and 7 are of a quadplane, or of 4.7


def plane(intent: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    policy, wings = intent.policy, intent.wings
    if wings is None:
        raise NoParameterTable(
            "it is a fixed wing and is planned for as what hovers; say `airframe: plane` of it"
        )
    watched = policy.lost_link != "continue"
    return (
        exactly("FS_GCS_ENABL", intent.lost_link, 1.0 if watched else 0.0),
        *(
            (
                one("FS_LONG_ACTN", intent.lost_link, {"return": (1.0,)}, policy.lost_link),
                exactly("FS_LONG_TIMEOUT", intent.lost_link_after, policy.lost_link_after_s),
                exactly(_gcs(version), intent.lost_link, intent.gcs_sysid),
            )
            if watched
            else ()
        ),
        one("BATT_FS_LOW_ACT", intent.low_battery, {"return": (1.0,), "land": (2.0,)}, policy.low_battery),
        _critical(intent, _PLANE_CRITICAL),
        *_battery(intent),
        *_fence(intent),
        one("FENCE_ACTION", intent.fence_breach, {"return": (1.0,)}, policy.fence_breach),
        *_plane_circles(intent, wings),
        *_plane_flight(intent),
    )


def _plane_circles(intent: DeclaredBehaviour, wings: FixedWing) -> tuple[RequiredParameter, ...]:
    """It holds and returns in circles as wide as reckoned with, lands once it is home, and can fly slowly
    enough. The sign of a radius is the way round."""
    most_m, slowest_m_s = wings.loiter_radius_m, wings.min_speed_m_s
    radius = f"wings.loiter_radius_m: {most_m:g}"
    return (
        RequiredParameter("WP_LOITER_RAD", radius, most_m, least=-most_m, most=most_m),
        RequiredParameter("RTL_RADIUS", radius, 0.0, least=-most_m, most=most_m),
        exactly("RTL_AUTOLAND", "a return that ends in a landing", _LANDS_ONCE_HOME),
        RequiredParameter(
            "RTL_ALTITUDE",
            "a return at the height it flies at" if intent.among_others else intent.fence,
            _PRESENT_ALTITUDE,
            (_PRESENT_ALTITUDE,),
            # It comes down for this, too.
            least=intent.altitude_m if intent.among_others else wings.final_height_m,
            most=intent.altitude_m if intent.among_others else intent.ceiling_m,
        ),
        RequiredParameter(
            "AIRSPEED_MIN", f"wings.min_speed_m_s: {slowest_m_s:g}", least=0.0, most=slowest_m_s
        ),
    )


def _plane_flight(intent: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    """It cruises as fast and banks as far as its turns are reckoned with, and flies past a waypoint that it
    cannot hit. WP_RADIUS says nothing: each waypoint of ours has a radius of its own (param2).

    A quadplane says that it is a fixed wing where Q_MAV_TYPE is 0 (`QuadPlane::get_mav_type`), and takes off,
    lands and holds in another way. How fast it is flown its owner decides.
    """
    return (
        *cruise(intent, "AIRSPEED_CRUISE", "ROLL_LIMIT_DEG"),
        exactly("WP_MAX_RADIUS", "no circling at a waypoint", 0.0),
        RequiredParameter("Q_ENABLE", "airframe: plane", values=(0.0,)),
    )


def _critical(intent: DeclaredBehaviour, values: tuple[float, ...]) -> RequiredParameter:
    """Where the battery is still lower it does no more, returns or lands: no motor stops in the air."""
    return RequiredParameter("BATT_FS_CRT_ACT", intent.low_battery, 0.0, values)


def _battery(intent: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    """There is a monitor, a voltage that counts as low, and a time after which it does, of which none is
    never: they depend on what is built in."""
    return tuple(
        above_zero(name, intent.low_battery) for name in ("BATT_MONITOR", "BATT_LOW_VOLT", "BATT_LOW_TIMER")
    )


def _fence(intent: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    return (
        exactly("FENCE_ENABLE", intent.fence, 1.0),
        exactly("FENCE_TYPE", intent.fence, _HEIGHT_AND_POLYGON),
        ceiling("FENCE_ALT_MAX", intent),
    )
