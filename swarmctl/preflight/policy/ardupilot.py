"""Parameter tables of ArduCopter and ArduPlane; `copter_flight` has the flight of a copter. Pure."""

from __future__ import annotations

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.preflight.policy import copter_flight
from swarmctl.preflight.policy.behaviour import (
    SETPOINTS_STOP,
    DeclaredBehaviour,
    ceiling,
    cruise_and_bank,
)
from swarmctl.preflight.policy.required import (
    RequiredParameter,
    Version,
    above_zero,
    exactly,
    one_of,
)


def _gcs_parameter(version: Version) -> str:
    return "MAV_GCS_SYSID" if version >= (4, 7) else "SYSID_MYGCS"


# The second value of "return" is SmartRTL, a return along the flown track.
_COPTER_LOST_LINK = {"return": (1.0, 3.0), "land": (5.0,), "hold": (7.0,), "continue": (0.0,)}
_COPTER_BATTERY = {"return": (2.0, 3.0), "land": (1.0,)}
_COPTER_CRITICAL = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0)  # 5: Terminate
_COPTER_FENCE = {"return": (1.0, 3.0), "land": (2.0,), "hold": (4.0,)}
_CONTINUE_IN_AUTO_BIT = 1  # of FS_OPTIONS
_HEIGHT_AND_POLYGON = 5.0  # FENCE_TYPE; without the circle around home, which no configuration declares


def copter(behaviour: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    policy = behaviour.policy
    return (
        one_of("FS_GCS_ENABLE", behaviour.lost_link, _COPTER_LOST_LINK, policy.lost_link),
        *(
            (
                exactly("FS_GCS_TIMEOUT", behaviour.lost_link_after, policy.lost_link_after_s),
                RequiredParameter("FS_OPTIONS", behaviour.lost_link, bit=_CONTINUE_IN_AUTO_BIT),
                exactly(_gcs_parameter(version), behaviour.lost_link, behaviour.gcs_sysid),
            )
            if policy.lost_link != "continue"
            else ()
        ),
        one_of("BATT_FS_LOW_ACT", behaviour.low_battery, _COPTER_BATTERY, policy.low_battery),
        _critical_battery(behaviour, _COPTER_CRITICAL),
        *_battery_monitor(behaviour),
        *_fence(behaviour),
        one_of("FENCE_ACTION", behaviour.fence_breach, _COPTER_FENCE, policy.fence_breach),
        *_copter_position_loss(),
        *copter_flight.returns(behaviour, version),
        *copter_flight.flight(behaviour, version),
        *(_setpoints_stop() if behaviour.in_formation else ()),
    )


_GUIDED_TIMEOUT_S, _MIN_GUIDED_TIMEOUT_S, _MAX_GUIDED_TIMEOUT_S = 3.0, 1.0, 3.0  # of GUID_TIMEOUT


def _setpoints_stop() -> tuple[RequiredParameter, ...]:
    """Return the time after which a copter stops whose set-points have stopped; until then it flies on."""
    least_s, most_s = _MIN_GUIDED_TIMEOUT_S, _MAX_GUIDED_TIMEOUT_S
    return (RequiredParameter("GUID_TIMEOUT", SETPOINTS_STOP, _GUIDED_TIMEOUT_S, least=least_s, most=most_s),)


_EKF_LAND, _EKF_LAND_ALWAYS = 1.0, 3.0  # of FS_EKF_ACTION; 2: altitude hold for a pilot; 0: only a report
_MAX_EKF_THRESH = 1.0  # of FS_EKF_THRESH; 0 turns the check off


def _copter_position_loss() -> tuple[RequiredParameter, ...]:
    """Return the parameters of a landing after the loss of the position estimate."""
    declared = "a landing after the loss of the position estimate"
    return (
        RequiredParameter("FS_EKF_ACTION", declared, _EKF_LAND, (_EKF_LAND, _EKF_LAND_ALWAYS)),
        RequiredParameter("FS_EKF_THRESH", declared, 0.8, least=0.1, most=_MAX_EKF_THRESH),
    )


_CURRENT_ALTITUDE = -1.0  # of RTL_ALTITUDE
_LAND_AT_HOME = 1.0  # of RTL_AUTOLAND; with 0 and a landing in its mission a plane does not arm
_PLANE_CRITICAL = (0.0, 1.0, 2.0)  # 3: Terminate, 5: Parachute; 4, 6 and 7 need a quadplane, or 4.7


def plane(behaviour: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    policy, wings = behaviour.policy, behaviour.fixed_wing()
    watched = policy.lost_link != "continue"
    return (
        exactly("FS_GCS_ENABL", behaviour.lost_link, 1.0 if watched else 0.0),
        *(
            (
                one_of("FS_LONG_ACTN", behaviour.lost_link, {"return": (1.0,)}, policy.lost_link),
                exactly("FS_LONG_TIMEOUT", behaviour.lost_link_after, policy.lost_link_after_s),
                exactly(_gcs_parameter(version), behaviour.lost_link, behaviour.gcs_sysid),
            )
            if watched
            else ()
        ),
        one_of(
            "BATT_FS_LOW_ACT", behaviour.low_battery, {"return": (1.0,), "land": (2.0,)}, policy.low_battery
        ),
        _critical_battery(behaviour, _PLANE_CRITICAL),
        *_battery_monitor(behaviour),
        *_fence(behaviour),
        one_of("FENCE_ACTION", behaviour.fence_breach, {"return": (1.0,)}, policy.fence_breach),
        *_plane_circles(behaviour, wings),
        *_plane_flight(behaviour),
    )


def _plane_circles(behaviour: DeclaredBehaviour, wings: FixedWing) -> tuple[RequiredParameter, ...]:
    """Return the parameters of circles, of the return to a landing, and of the least speed.

    Circles are no wider than plans assume. The sign of a radius is the direction of the circle.
    """
    max_radius_m, min_speed_m_s = wings.loiter_radius_m, wings.min_speed_m_s
    radius = f"wings.loiter_radius_m: {max_radius_m:g}"
    return (
        RequiredParameter("WP_LOITER_RAD", radius, max_radius_m, least=-max_radius_m, most=max_radius_m),
        RequiredParameter("RTL_RADIUS", radius, 0.0, least=-max_radius_m, most=max_radius_m),
        exactly("RTL_AUTOLAND", "a return that ends in a landing", _LAND_AT_HOME),
        RequiredParameter(
            "RTL_ALTITUDE",
            "a return at the flight altitude" if behaviour.among_others else behaviour.fence,
            _CURRENT_ALTITUDE,
            (_CURRENT_ALTITUDE,),
            # ArduPlane also descends to this altitude.
            least=behaviour.altitude_m if behaviour.among_others else wings.final_height_m,
            most=behaviour.altitude_m if behaviour.among_others else behaviour.ceiling_m,
        ),
        RequiredParameter(
            "AIRSPEED_MIN", f"wings.min_speed_m_s: {min_speed_m_s:g}", least=0.0, most=min_speed_m_s
        ),
    )


def _plane_flight(behaviour: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    """Return the parameters of cruise and turns, of missed waypoints, and of quadplanes.

    WP_RADIUS has no effect: each uploaded waypoint has its own radius (param2). A quadplane reports a fixed
    wing if Q_MAV_TYPE is 0 (`QuadPlane::get_mav_type`), but takes off, lands and holds differently.
    """
    return (
        *cruise_and_bank(behaviour, "AIRSPEED_CRUISE", "ROLL_LIMIT_DEG"),
        exactly("WP_MAX_RADIUS", "no circling at a waypoint", 0.0),
        RequiredParameter("Q_ENABLE", "airframe: plane", values=(0.0,)),
    )


def _critical_battery(behaviour: DeclaredBehaviour, values: tuple[float, ...]) -> RequiredParameter:
    """Return the requirement on the critical-battery action; `values` are actions without a motor stop."""
    return RequiredParameter("BATT_FS_CRT_ACT", behaviour.low_battery, 0.0, values)


def _battery_monitor(behaviour: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    """Return the parameters of the battery monitor: the owner's values, above 0."""
    return tuple(
        above_zero(name, behaviour.low_battery)
        for name in ("BATT_MONITOR", "BATT_LOW_VOLT", "BATT_LOW_TIMER")
    )


def _fence(behaviour: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    return (
        exactly("FENCE_ENABLE", behaviour.fence, 1.0),
        exactly("FENCE_TYPE", behaviour.fence, _HEIGHT_AND_POLYGON),
        ceiling("FENCE_ALT_MAX", behaviour),
    )
