"""Its battery lasts for the route and the way back, with a reserve; and it is low before it is empty."""

from __future__ import annotations

from swarmctl.core.geo import distance_m
from swarmctl.preflight.facts import MAX_AGE_S, Finding, PreflightFacts, no_route

NAME = "battery"
WAIVABLE = True
FULL_PERCENT = 100.0


def check(facts: PreflightFacts) -> Finding:
    if facts.endurance_s is None:
        cure = "set preflight.endurance_s to what a full battery flies"
        return Finding(False, "nobody has said how long it flies", "preflight.endurance_s", cure)
    seconds = flight_s(facts)
    if seconds is None:
        return Finding(False, *no_route(facts, "a route and the way back"))
    needs = 100.0 * seconds / facts.endurance_s + facts.reserve_percent
    wanted = f"{needs:.0f} %: {seconds:.0f} s there and back, {facts.reserve_percent:g} % in reserve"
    percent = facts.state.battery_percent
    if percent is not None and not facts.status_age_s <= MAX_AGE_S:
        found = f"{percent} %, as told {facts.status_age_s:.0f} s ago"
        return Finding(False, found, wanted, "see why SYS_STATUS does not come any more")
    if percent is None:
        return Finding(False, "it does not tell its charge", wanted, "look at its battery monitor")
    if not _is_low_in_time(facts):
        return Finding(False, *_low_too_late(facts))
    enough = percent >= needs
    return Finding(enough, f"{percent} %", wanted, "" if enough else _cure(needs))


LOW_NAME = "BATT_LOW_VOLT"
"""ArduPilot's: what is checked of it elsewhere is that there is one"""
EMPTY_SHARE = 2.5 / 4.2
"""of the voltage of a full lithium cell where it is empty, whichever kind it is: a battery of any number of
cells is low before it has come down by so much, from what it tells now as well"""


def _is_low_in_time(facts: PreflightFacts) -> bool:
    low_v, told_v = facts.parameters.get(LOW_NAME), facts.state.battery_v
    return low_v is None or (told_v is not None and low_v >= EMPTY_SHARE * told_v)


def _low_too_late(facts: PreflightFacts) -> tuple[str, str, str]:
    """Found, wanted and cure."""
    low, told_v = f"low at {facts.parameters[LOW_NAME]:g} V", facts.state.battery_v
    if told_v is None:
        return f"{low}, and no voltage is told", "a voltage that may be low", "look at its battery monitor"
    wanted = f"low at {EMPTY_SHARE * told_v:.1f} V or more, where a lithium battery is empty"
    cure = f"set {LOW_NAME} to what this battery is low at, or look at its battery monitor"
    return f"{low}, and {told_v:.1f} V are told", wanted, cure


def _cure(needs_percent: float) -> str:
    if needs_percent <= FULL_PERCENT:
        return "charge it, or give it a shorter way"
    return "no charge is enough: give it a shorter way, or correct preflight.endurance_s or reserve_percent"


def flight_s(facts: PreflightFacts) -> float | None:
    """Its first route from take-off to touch-down, and straight back from its end to where it stands [s]."""
    state = facts.state
    if facts.flight is None or facts.plan is None or state.lat_deg is None or state.lon_deg is None:
        return None
    end = (facts.plan.landing.lat_deg, facts.plan.landing.lon_deg)
    lasts_s = facts.flight.times_s[-1] - facts.flight.times_s[0]
    return lasts_s + distance_m(end, (state.lat_deg, state.lon_deg)) / facts.speed_m_s
