"""Check `battery`: the charge lasts for the route and the way back, and the low-battery voltage is safe."""

from __future__ import annotations

from swarmctl.core.geo import distance_m
from swarmctl.preflight.facts import MAX_AGE_S, Finding, PreflightFacts, without_route

NAME = "battery"
WAIVABLE = True
FULL_PERCENT = 100.0


def check(facts: PreflightFacts) -> Finding:
    if facts.endurance_s is None:
        cure = "set preflight.endurance_s to the flight time of a full battery in seconds"
        return Finding(False, "no configured flight time", "a flight time of a full battery", cure)
    duration_s = flight_s(facts)
    if duration_s is None:
        return Finding(False, *without_route(facts, "a route and the way back"))
    needed_percent = 100.0 * duration_s / facts.endurance_s + facts.reserve_percent
    reserve = f"{facts.reserve_percent:g} % reserve"
    wanted = f"{needed_percent:.0f} % ({duration_s:.0f} s to the goal and back, and {reserve})"
    percent = facts.state.battery_percent
    if percent is not None and not facts.status_age_s <= MAX_AGE_S:
        found = f"{percent} %, reported {facts.status_age_s:.0f} s ago"
        return Finding(False, found, wanted, "find out why the vehicle no longer sends SYS_STATUS")
    if percent is None:
        return Finding(False, "no charge in SYS_STATUS", wanted, "check the battery monitor")
    if not _is_low_voltage_safe(facts):
        return Finding(False, *_unsafe_low_voltage(facts))
    is_enough = percent >= needed_percent
    return Finding(is_enough, f"{percent} %", wanted, "" if is_enough else _cure(needed_percent))


LOW_NAME = "BATT_LOW_VOLT"
"""ArduPilot's voltage of a low battery; the check `parameters` requires a value above 0"""
EMPTY_SHARE = 2.5 / 4.2
"""Voltage of an empty lithium cell of any kind, as a share of a full cell's voltage. BATT_LOW_VOLT has to be
at least this share of the present voltage, for any number of cells."""


def _is_low_voltage_safe(facts: PreflightFacts) -> bool:
    low_v, reported_v = facts.parameters.get(LOW_NAME), facts.state.battery_v
    return low_v is None or (reported_v is not None and low_v >= EMPTY_SHARE * reported_v)


def _unsafe_low_voltage(facts: PreflightFacts) -> tuple[str, str, str]:
    """Return found, wanted and cure."""
    low, reported_v = f"{LOW_NAME} {facts.parameters[LOW_NAME]:g} V", facts.state.battery_v
    if reported_v is None:
        return f"{low}, no voltage in SYS_STATUS", "a reported voltage", "check the battery monitor"
    wanted = f"{LOW_NAME} {EMPTY_SHARE * reported_v:.1f} V or more, the voltage of an empty lithium battery"
    cure = f"set {LOW_NAME} to the low voltage of this battery, or check the battery monitor"
    return f"{low} at a voltage of {reported_v:.1f} V", wanted, cure


def _cure(needed_percent: float) -> str:
    if needed_percent <= FULL_PERCENT:
        return "charge the battery, or shorten the route"
    keys = "preflight.endurance_s or preflight.reserve_percent"
    return f"a full battery is not enough: shorten the route, or correct {keys}"


def flight_s(facts: PreflightFacts) -> float | None:
    """Return the time of the first route and of a straight return to the present position [s].

    None if the route or the position is unknown.
    """
    state = facts.state
    if facts.trajectory is None or facts.plan is None or state.lat_deg is None or state.lon_deg is None:
        return None
    end = (facts.plan.landing.lat_deg, facts.plan.landing.lon_deg)
    route_s = facts.trajectory.times_s[-1] - facts.trajectory.times_s[0]
    return route_s + distance_m(end, (state.lat_deg, state.lon_deg)) / facts.speed_m_s
