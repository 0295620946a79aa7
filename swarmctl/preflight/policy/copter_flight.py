"""Parameters of an ArduCopter's flight, return and landing, with the values that plans assume. Pure.

Each change into AUTO applies these parameters again, and ends the effect of a speed command
(`ModeAuto::init`). Up to version 4.6 speeds and heights are in centimetres. From 4.7 on they are in metres,
with other names (https://ardupilot.org/copter/docs/common-param-name-changes.html).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from swarmctl.agent.replan.climb import CLIMB_M_S, DESCENT_M_S
from swarmctl.agent.replan.copter_trajectory import LAND_M_S, LOW_M
from swarmctl.agent.replan.travel_time import ACCELERATION_M_S2, CORNER_RADIUS_M
from swarmctl.agent.traffic.return_schedule import FAST_FACTOR
from swarmctl.core.records import replace
from swarmctl.preflight.policy.behaviour import DeclaredBehaviour, cruise_speed
from swarmctl.preflight.policy.required import RequiredParameter, Version, exactly

_FIRST_IN_METRES: Version = (4, 7)
_OLD_NAMES = {
    "LAND_ALT_LOW_M": "LAND_ALT_LOW",
    "LAND_SPD_HIGH_MS": "LAND_SPEED_HIGH",
    "LAND_SPD_MS": "LAND_SPEED",
    "RTL_ALT_FINAL_M": "RTL_ALT_FINAL",
    "RTL_ALT_M": "RTL_ALT",
    "RTL_CLIMB_MIN_M": "RTL_CLIMB_MIN",
    "RTL_SPEED_MS": "RTL_SPEED",
    "WP_ACC": "WPNAV_ACCEL",
    "WP_RADIUS_M": "WPNAV_RADIUS",
    "WP_SPD": "WPNAV_SPEED",
    "WP_SPD_DN": "WPNAV_SPEED_DN",
    "WP_SPD_UP": "WPNAV_SPEED_UP",
}
"""name since 4.7 -> name up to 4.6"""
_CM_PER_M = 100.0


def flight(behaviour: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    """Return the parameters of the mission flight and of the landing."""
    required = (*_mission_flight(behaviour), *_landing(behaviour))
    return tuple(_for_version(parameter, version) for parameter in required)


def returns(behaviour: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    """Return the parameters of the return to launch."""
    renamed = (_for_version(parameter, version) for parameter in _returns(behaviour))
    hover = RequiredParameter("RTL_LOIT_TIME", _LANDS, _DEFAULT_HOVER_MS, least=0.0, most=_MAX_HOVER_MS)
    return (*renamed, hover)


def _for_version(parameter: RequiredParameter, version: Version) -> RequiredParameter:
    """Return a parameter of version 4.7 with the name and unit of `version`."""
    if version >= _FIRST_IN_METRES:
        return parameter
    return replace(
        parameter,
        name=_OLD_NAMES[parameter.name],
        declared=f"{parameter.declared}; the parameter counts centimetres, not metres",
        set_to=None if parameter.set_to is None else _cm(parameter.set_to),
        values=tuple(_cm(value) for value in parameter.values),
        least=_cm(parameter.least),
        most=_cm(parameter.most),
    )


def _cm(value_m: float) -> float:
    return round(_CM_PER_M * value_m, 6)


def _mission_flight(behaviour: DeclaredBehaviour) -> Iterator[RequiredParameter]:
    yield cruise_speed("WP_SPD", behaviour)
    yield _as_planned("WP_SPD_UP", f"a climb at {CLIMB_M_S:g} m/s", CLIMB_M_S, behaviour)
    yield _as_planned("WP_SPD_DN", f"a descent at {DESCENT_M_S:g} m/s", DESCENT_M_S, behaviour)
    brakes = f"braking by {ACCELERATION_M_S2:g} m/s^2"
    yield _as_planned("WP_ACC", brakes, ACCELERATION_M_S2, behaviour)
    corners = f"turns within {CORNER_RADIUS_M:g} m of a waypoint"
    yield RequiredParameter("WP_RADIUS_M", corners, CORNER_RADIUS_M, least=0.0, most=CORNER_RADIUS_M)


_USE_WP_SPD_DN = 0.0  # LAND_SPD_HIGH_MS 0: the copter descends at WP_SPD_DN


def _landing(behaviour: DeclaredBehaviour) -> Iterator[RequiredParameter]:
    landing = f"a landing at {LAND_M_S:g} m/s below {LOW_M:g} m"
    high = f"a descent at {DESCENT_M_S:g} m/s to {LOW_M:g} m"
    yield _as_planned("LAND_SPD_MS", landing, LAND_M_S, behaviour)
    yield replace(_as_planned("LAND_SPD_HIGH_MS", high, DESCENT_M_S, behaviour), values=(_USE_WP_SPD_DN,))
    low = _as_planned("LAND_ALT_LOW_M", landing, LOW_M, behaviour)
    # A lower value is safe: the vehicle slows down later and lands sooner.
    yield replace(low, least=low.least if behaviour.among_others else 0.0, most=(1.0 + _TOLERANCE) * LOW_M)


_TOLERANCE = 0.1
"""accepted deviation from a value that plans assume, as a share"""


def _as_planned(name: str, declared: str, planned: float, behaviour: DeclaredBehaviour) -> RequiredParameter:
    """Return the requirement on a value that plans assume. This program does not write the parameter.

    A slower vehicle is late and needs more charge. A faster vehicle is ahead of the predicted position.
    """
    most = (1.0 + _TOLERANCE) * planned if behaviour.among_others else math.inf
    return RequiredParameter(name, declared, least=(1.0 - _TOLERANCE) * planned, most=most)


_LANDS = "a return that ends in a landing"
_LAND_AT_HOME = 0.0  # RTL_ALT_FINAL_M 0: the copter lands; above 0 it hovers at that height
_USE_WP_SPD = 0.0  # RTL_SPEED_MS 0: the copter returns at WP_SPD
_DEFAULT_RETURN_ALT_M = 15.0  # of RTL_ALT
_DEFAULT_HOVER_MS = 5000.0  # of RTL_LOIT_TIME
_MAX_HOVER_MS = 20_000.0  # the return schedule allows for this time (`return_schedule.SINK_M_S`)


def _returns(behaviour: DeclaredBehaviour) -> Iterator[RequiredParameter]:
    """Yield the parameters of a return: a climb to RTL_ALT, home at cruise speed, and a landing."""
    most_m = behaviour.max_return_height_m
    yield RequiredParameter(
        "RTL_ALT_M", behaviour.returns, min(_DEFAULT_RETURN_ALT_M, most_m), least=0.0, most=most_m
    )
    yield exactly("RTL_CLIMB_MIN_M", behaviour.returns, 0.0)
    yield exactly("RTL_ALT_FINAL_M", _LANDS, _LAND_AT_HOME)
    speed = cruise_speed("RTL_SPEED_MS", behaviour)
    fastest_m_s = FAST_FACTOR * behaviour.speed_m_s
    yield replace(speed, set_to=_USE_WP_SPD, values=(_USE_WP_SPD,), most=fastest_m_s)
