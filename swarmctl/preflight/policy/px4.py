"""The tables of PX4's copters and planes. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarmctl.agent.replan.landing_pattern import FixedWing
from swarmctl.agent.replan.travel_time import CORNER_RADIUS_M
from swarmctl.preflight.policy.behaviour import DeclaredBehaviour, ceiling, cruise, cruises
from swarmctl.preflight.policy.required import NoParameterTable, RequiredParameter, Version, exactly, one

_LOST_LINK = {"return": (2.0,), "land": (3.0,), "hold": (1.0,), "continue": (0.0,)}
_BATTERY = {"return": (3.0,), "land": (2.0,)}
_FENCE = {"return": (3.0,), "land": (5.0,), "hold": (2.0,)}
_MISSION_EXCEPTED = 0  # bit of COM_DLL_EXCEPT, which all of 1.16 have, and none before
_RETURNS_AT_M = 30.0  # RTL_RETURN_ALT as it comes
_STRAIGHT_HOME = 0.0  # of RTL_TYPE; the others may lead to the landing of the mission, which is at the goal
_MOST_DELAY_S = 300.0  # of RTL_LAND_DELAY; with -1 it stays in the air over home

_CORNERS = f"corners that are turned within {CORNER_RADIUS_M:g} m"


def copter(intent: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    return (
        *_link(intent, version, _LOST_LINK),
        one("COM_LOW_BAT_ACT", intent.low_battery, _BATTERY, intent.policy.low_battery),
        one("GF_ACTION", intent.fence_breach, _FENCE, intent.policy.fence_breach),
        *_heights(intent),
        exactly("RTL_TYPE", "a return to where it took off", _STRAIGHT_HOME),
        RequiredParameter(
            "RTL_LAND_DELAY", "a return that ends in a landing", 0.0, least=0.0, most=_MOST_DELAY_S
        ),
        # As it comes it flies its mission at half the speed that is reckoned with where nobody says.
        cruises("MPC_XY_CRUISE", intent),
        # No waypoint of ours says another (param2).
        RequiredParameter("NAV_ACC_RAD", _CORNERS, CORNER_RADIUS_M, least=0.0, most=CORNER_RADIUS_M),
    )


# AUTO.LAND of a fixed wing comes down in a circle wherever it is, and what it would hold outside of its fence
# is a circle too: neither may be declared.
_PLANE_LOST_LINK = {"return": (2.0,), "hold": (1.0,), "continue": (0.0,)}
_TO_THE_MISSIONS_LANDING = 1.0  # of RTL_TYPE
_LEAST_RADIUS_M = 1.0
_WITHOUT_TERRAIN = 0  # bit of FW_LND_ABORT, set as it comes: it breaks off and circles over the touch-down
_STEEPER_DEG = 0.5  # than the slope that is reckoned with, so that roundings do not count
_ALTITUDE_OFF_M = 10.0  # NAV_FW_ALT_RAD as it comes


def plane(intent: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    policy, wings = intent.policy, intent.wings
    if wings is None:
        raise NoParameterTable(
            "it is a fixed wing and is planned for as what hovers; say `airframe: plane` of it"
        )
    return (
        *_link(intent, version, _PLANE_LOST_LINK),
        one("COM_LOW_BAT_ACT", intent.low_battery, {"return": (3.0,)}, policy.low_battery),
        one("GF_ACTION", intent.fence_breach, {"return": (3.0,)}, policy.fence_breach),
        *_heights(intent),
        *_circles(intent, wings),
        *cruise(intent, "FW_AIRSPD_TRIM", "FW_R_LIM"),
    )


def _circles(intent: DeclaredBehaviour, wings: FixedWing) -> tuple[RequiredParameter, ...]:
    """It returns to the landing of its mission, holds in circles as wide as reckoned with, may come down that
    slope, climbs on its way and not in a circle at its first waypoint, and can fly slowly enough."""
    most_m, slowest_m_s = wings.loiter_radius_m, wings.min_speed_m_s
    steep_deg = wings.glide_from_circle_deg
    climbs_m = max(intent.altitude_m - wings.takeoff_height_m, _ALTITUDE_OFF_M)
    return (
        exactly("RTL_TYPE", "a return that ends in a landing", _TO_THE_MISSIONS_LANDING),
        RequiredParameter(
            "NAV_LOITER_RAD",
            f"wings.loiter_radius_m: {most_m:g}",
            most_m,
            least=_LEAST_RADIUS_M,
            most=most_m,
        ),
        RequiredParameter(
            "FW_LND_ANG",
            f"a landing as wings says, {steep_deg:.1f} degrees steep",
            float(math.ceil(steep_deg + _STEEPER_DEG)),
            least=steep_deg,
            most=90.0,
        ),
        RequiredParameter("FW_LND_ABORT", "a landing that needs no range finder", bit=_WITHOUT_TERRAIN),
        RequiredParameter(
            "NAV_ACC_RAD", "no turn that is begun earlier", least=0.0, most=intent.turn_radius_m
        ),
        RequiredParameter("NAV_FW_ALT_RAD", "a climb on its way", climbs_m, least=climbs_m, most=math.inf),
        RequiredParameter(
            "FW_AIRSPD_MIN", f"wings.min_speed_m_s: {slowest_m_s:g}", least=0.0, most=slowest_m_s
        ),
    )


def _link(
    intent: DeclaredBehaviour, version: Version, actions: Mapping[str, tuple[float, ...]]
) -> tuple[RequiredParameter, ...]:
    policy = intent.policy
    watched = policy.lost_link != "continue"
    return (
        one("NAV_DLL_ACT", intent.lost_link, actions, policy.lost_link),
        *((exactly("COM_DL_LOSS_T", intent.lost_link_after, policy.lost_link_after_s),) if watched else ()),
        *(
            (RequiredParameter("COM_DLL_EXCEPT", intent.lost_link, bit=_MISSION_EXCEPTED),)
            if watched and version >= (1, 16)
            else ()
        ),
    )


def _heights(intent: DeclaredBehaviour) -> tuple[RequiredParameter, ...]:
    return (
        ceiling("GF_MAX_VER_DIST", intent),
        exactly("GF_MAX_HOR_DIST", intent.fence, 0.0),
        RequiredParameter(
            "RTL_RETURN_ALT",
            intent.returns,
            min(_RETURNS_AT_M, intent.returns_at_most_m),
            least=0.0,
            most=intent.returns_at_most_m,
        ),
    )
