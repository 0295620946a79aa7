"""How an ArduCopter flies, returns and comes down, as is reckoned with: by its parameters' names. Pure.

Its mission is flown by these from every change into AUTO on: no speed that was ordered before outlasts that
(`ModeAuto::init`). Until 4.6 speeds and heights are in centimetres; from 4.7 on all of them have other names
and are in metres (https://ardupilot.org/copter/docs/common-param-name-changes.html).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from swarmctl.agent.replan.length_bounds import CLIMB_M_S
from swarmctl.agent.replan.copter_trajectory import DESCENT_M_S, LAND_M_S, LOW_M
from swarmctl.agent.replan.travel_time import ACCELERATION_M_S2, CORNER_RADIUS_M
from swarmctl.agent.traffic.return_turns import FASTER
from swarmctl.preflight.policy.behaviour import DeclaredBehaviour, cruises
from swarmctl.preflight.policy.required import RequiredParameter, Version, exactly

_SINCE: Version = (4, 7)
_BEFORE = {
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
"""since 4.7 -> before"""
_CM = 100.0


def flight(intent: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    return tuple(_in_its_units(wanted, version) for wanted in (*_on_its_way(intent), *_down(intent)))


def returns(intent: DeclaredBehaviour, version: Version) -> tuple[RequiredParameter, ...]:
    own = (_in_its_units(wanted, version) for wanted in _returns(intent))
    lands = RequiredParameter("RTL_LOIT_TIME", _LANDS, _WAITS_MS, least=0.0, most=_MOST_WAIT_MS)
    return (*own, lands)


def _in_its_units(wanted: RequiredParameter, version: Version) -> RequiredParameter:
    """Of what is said in metres, by its name of 4.7."""
    if version >= _SINCE:
        return wanted
    return replace(
        wanted,
        name=_BEFORE[wanted.name],
        set_to=None if wanted.set_to is None else _cm(wanted.set_to),
        values=tuple(_cm(value) for value in wanted.values),
        least=_cm(wanted.least),
        most=_cm(wanted.most),
    )


def _cm(value_m: float) -> float:
    return round(_CM * value_m, 6)


def _on_its_way(intent: DeclaredBehaviour) -> Iterator[RequiredParameter]:
    yield cruises("WP_SPD", intent)
    yield _about("WP_SPD_UP", f"a climb at {CLIMB_M_S:g} m/s", CLIMB_M_S, intent)
    yield _about("WP_SPD_DN", f"a descent at {DESCENT_M_S:g} m/s", DESCENT_M_S, intent)
    brakes = f"braking by {ACCELERATION_M_S2:g} m/s^2"
    yield _about("WP_ACC", brakes, ACCELERATION_M_S2, intent)
    corners = f"corners that are turned within {CORNER_RADIUS_M:g} m"
    yield RequiredParameter("WP_RADIUS_M", corners, CORNER_RADIUS_M, least=0.0, most=CORNER_RADIUS_M)


_AS_DESCENTS = 0.0  # of LAND_SPD_HIGH_MS: WP_SPD_DN


def _down(intent: DeclaredBehaviour) -> Iterator[RequiredParameter]:
    landing = f"a landing at {LAND_M_S:g} m/s from {LOW_M:g} m on"
    high = f"a descent at {DESCENT_M_S:g} m/s to {LOW_M:g} m"
    yield _about("LAND_SPD_MS", landing, LAND_M_S, intent)
    yield replace(_about("LAND_SPD_HIGH_MS", high, DESCENT_M_S, intent), values=(_AS_DESCENTS,))
    low = _about("LAND_ALT_LOW_M", landing, LOW_M, intent)
    # Who comes low later is down sooner.
    yield replace(low, least=low.least if intent.among_others else 0.0, most=(1.0 + _OFF) * LOW_M)


_OFF = 0.1
"""so much of it a rate may differ from the one that is reckoned with"""


def _about(name: str, declared: str, rate: float, intent: DeclaredBehaviour) -> RequiredParameter:
    """A rate, which its owner decides. Who is slower is late, and needs more of its battery; who is faster is
    not where others take it to be."""
    most = (1.0 + _OFF) * rate if intent.among_others else math.inf
    return RequiredParameter(name, declared, least=(1.0 - _OFF) * rate, most=most)


_LANDS = "a return that ends in a landing"
_LANDS_FROM_ANY_HEIGHT = 0.0  # of RTL_ALT_FINAL_M; above 0 it goes to that height and stays there
_AS_IT_CRUISES = 0.0  # of RTL_SPEED_MS: WP_SPD
_RETURNS_AT_M = 15.0  # RTL_ALT as it comes
_WAITS_MS = 5000.0  # RTL_LOIT_TIME as it comes
_MOST_WAIT_MS = 20_000.0  # what turns leave room for (`core.returns.SINK_M_S`)


def _returns(intent: DeclaredBehaviour) -> Iterator[RequiredParameter]:
    """It climbs to RTL_ALT, and by RTL_CLIMB_MIN at least, comes home as fast as it flies, and lands."""
    most_m = intent.returns_at_most_m
    yield RequiredParameter("RTL_ALT_M", intent.returns, min(_RETURNS_AT_M, most_m), least=0.0, most=most_m)
    yield exactly("RTL_CLIMB_MIN_M", intent.returns, 0.0)
    yield exactly("RTL_ALT_FINAL_M", _LANDS, _LANDS_FROM_ANY_HEIGHT)
    speed = cruises("RTL_SPEED_MS", intent)
    fastest_m_s = FASTER * intent.speed_m_s
    yield replace(speed, set_to=_AS_IT_CRUISES, values=(_AS_IT_CRUISES,), most=fastest_m_s)
