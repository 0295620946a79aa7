"""Parameter tables of PX4's copters and planes. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.replan.travel_time import ACCELERATION_M_S2, CORNER_RADIUS_M
from swarmctl.preflight.policy.behaviour import (
    SETPOINTS_STOP,
    DeclaredBehaviour,
    ceiling,
    cruise_and_bank,
    cruise_speed,
)
from swarmctl.preflight.policy.required import RequiredParameter, Version, exactly, one_of

_LOST_LINK = {"return": (2.0,), "land": (3.0,), "hold": (1.0,), "continue": (0.0,)}
_BATTERY = {"return": (3.0,), "land": (2.0,)}
_FENCE = {"return": (3.0,), "land": (5.0,), "hold": (2.0,)}
_MISSION_BIT = 0  # of COM_DLL_EXCEPT, a parameter since 1.16: no reaction to a lost link in a mission
_RETURN_ALT_M = 30.0  # of RTL_RETURN_ALT; the default of copters
_STRAIGHT_HOME = 0.0  # of RTL_TYPE; other values may lead to the mission's landing, at the goal
_DEFAULT_FIRST_WAYPOINT_M, _MAX_FIRST_WAYPOINT_M = 900.0, 10_000.0  # of MIS_DIST_1WP; 0 or less: no limit
_MAX_DELAY_S = 300.0  # of RTL_LAND_DELAY; -1: the copter stays in the air over home

_CORNERS = f"turns within {CORNER_RADIUS_M:g} m of a waypoint"
_BRAKES = f"braking by {ACCELERATION_M_S2:g} m/s^2 or more"


def copter(behaviour: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    return (
        *_link(behaviour, version, _LOST_LINK),
        one_of("COM_LOW_BAT_ACT", behaviour.low_battery, _BATTERY, behaviour.policy.low_battery),
        one_of("GF_ACTION", behaviour.fence_breach, _FENCE, behaviour.policy.fence_breach),
        *_heights(behaviour),
        exactly("RTL_TYPE", "a return to the take-off position", _STRAIGHT_HOME),
        RequiredParameter(
            "RTL_LAND_DELAY", "a return that ends in a landing", 0.0, least=0.0, most=_MAX_DELAY_S
        ),
        # The default is 5 m/s, half the default speed of plans.
        cruise_speed("MPC_XY_CRUISE", behaviour),
        RequiredParameter("MPC_ACC_HOR", _BRAKES, least=ACCELERATION_M_S2, most=math.inf),
        # Uploaded waypoints do not override this radius (param2).
        RequiredParameter("NAV_ACC_RAD", _CORNERS, CORNER_RADIUS_M, least=0.0, most=CORNER_RADIUS_M),
        # A mission begins where the vehicle is; during a change of the mission the vehicle flies on.
        *_first_waypoint(version, _DEFAULT_FIRST_WAYPOINT_M),
        *(_setpoints_stop() if behaviour.in_formation else ()),
    )


_RETURN, _LAND, _HOLD = (
    3.0,
    4.0,
    5.0,
)  # of COM_OBL_RC_ACT; 0 to 2: a pilot's modes
_SETPOINT_LOSS_S, _MAX_SETPOINT_LOSS_S = 1.0, 3.0  # of COM_OF_LOSS_T; the default is 1 s


def _setpoints_stop() -> tuple[RequiredParameter, ...]:
    """Return the parameters of the end of OFFBOARD; set-points come at 5 to 10 Hz, so several may be lost."""
    actions = (_RETURN, _LAND, _HOLD)
    return (
        RequiredParameter("COM_OBL_RC_ACT", SETPOINTS_STOP, _HOLD, actions),
        RequiredParameter(
            "COM_OF_LOSS_T",
            SETPOINTS_STOP,
            _SETPOINT_LOSS_S,
            least=_SETPOINT_LOSS_S,
            most=_MAX_SETPOINT_LOSS_S,
        ),
    )


# No "land": in AUTO.LAND a fixed wing descends in a circle wherever it is.
_PLANE_LOST_LINK = {"return": (2.0,), "hold": (1.0,), "continue": (0.0,)}
_MISSION_LANDING = 1.0  # of RTL_TYPE
_MIN_RADIUS_M = 1.0
_TERRAIN_BIT = 0  # of FW_LND_ABORT, set by default: without terrain data the vehicle circles over touchdown
_SLOPE_MARGIN_DEG = 0.5  # over the planned slope, for rounding
_DEFAULT_ALT_RAD_M = 10.0  # default of NAV_FW_ALT_RAD


def plane(behaviour: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    policy, wings = behaviour.policy, behaviour.fixed_wing()
    return (
        *_link(behaviour, version, _PLANE_LOST_LINK),
        one_of("COM_LOW_BAT_ACT", behaviour.low_battery, {"return": (3.0,)}, policy.low_battery),
        # No "hold": a fixed wing would circle outside of the fence.
        one_of("GF_ACTION", behaviour.fence_breach, {"return": (3.0,)}, policy.fence_breach),
        *_heights(behaviour),
        *_plane_flight(behaviour, wings),
        # A launch begins at the first waypoint. A landing from a hold begins far from the mission's begin.
        *_first_waypoint(version, max(behaviour.extent_m, _DEFAULT_FIRST_WAYPOINT_M)),
        *cruise_and_bank(behaviour, "FW_AIRSPD_TRIM", "FW_R_LIM"),
    )


def _plane_flight(behaviour: DeclaredBehaviour, wings: FixedWing) -> tuple[RequiredParameter, ...]:
    """Return the parameters of the return, the circles, the landing slope, the climb and the least speed.

    The return leads to the mission's landing. Circles are no wider than plans assume. A plane climbs along
    the route, not in a circle at the first waypoint.
    """
    most_m, slowest_m_s = wings.loiter_radius_m, wings.min_speed_m_s
    steep_deg = wings.glide_from_circle_deg
    altitude_radius_m = max(behaviour.altitude_m - wings.takeoff_height_m, _DEFAULT_ALT_RAD_M)
    return (
        exactly("RTL_TYPE", "a return that ends in a landing", _MISSION_LANDING),
        RequiredParameter(
            "NAV_LOITER_RAD",
            f"wings.loiter_radius_m: {most_m:g}",
            most_m,
            least=_MIN_RADIUS_M,
            most=most_m,
        ),
        RequiredParameter(
            "FW_LND_ANG",
            f"a landing by the section wings, {steep_deg:.1f} degrees steep",
            float(math.ceil(steep_deg + _SLOPE_MARGIN_DEG)),
            least=steep_deg,
            most=90.0,
        ),
        RequiredParameter("FW_LND_ABORT", "a landing that needs no range finder", bit=_TERRAIN_BIT),
        RequiredParameter(
            "NAV_ACC_RAD",
            "turns no earlier than turn_radius_m before a waypoint",
            least=0.0,
            most=behaviour.turn_radius_m,
        ),
        RequiredParameter(
            "NAV_FW_ALT_RAD",
            "a climb along the route, not in a circle",
            altitude_radius_m,
            least=altitude_radius_m,
            most=math.inf,
        ),
        RequiredParameter(
            "FW_AIRSPD_MIN", f"wings.min_speed_m_s: {slowest_m_s:g}", least=0.0, most=slowest_m_s
        ),
    )


def _link(
    behaviour: DeclaredBehaviour, version: Version, actions: Mapping[str, tuple[float, ...]]
) -> tuple[RequiredParameter, ...]:
    policy = behaviour.policy
    watched = policy.lost_link != "continue"
    return (
        one_of("NAV_DLL_ACT", behaviour.lost_link, actions, policy.lost_link),
        *(
            (exactly("COM_DL_LOSS_T", behaviour.lost_link_after, policy.lost_link_after_s),)
            if watched
            else ()
        ),
        *(
            (RequiredParameter("COM_DLL_EXCEPT", behaviour.lost_link, bit=_MISSION_BIT),)
            if watched and version >= (1, 16)
            else ()
        ),
    )


def _first_waypoint(version: Version, least_m: float) -> tuple[RequiredParameter, ...]:
    """Return the requirement that a mission may begin `least_m` [m] away; none for 1.16, which only warns."""
    if version >= (1, 16):
        return ()
    needs, least = f"a mission that begins {least_m:.0f} m from the vehicle", float(math.ceil(least_m))
    written = least if least <= _MAX_FIRST_WAYPOINT_M else 0.0
    return (RequiredParameter("MIS_DIST_1WP", needs, written, (0.0, -1.0), least=least_m, most=math.inf),)


def _heights(behaviour: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    return (
        ceiling("GF_MAX_VER_DIST", behaviour),
        exactly("GF_MAX_HOR_DIST", behaviour.fence, 0.0),
        RequiredParameter(
            "RTL_RETURN_ALT",
            behaviour.returns,
            min(_RETURN_ALT_M, behaviour.max_return_height_m),
            least=0.0,
            most=behaviour.max_return_height_m,
        ),
    )
