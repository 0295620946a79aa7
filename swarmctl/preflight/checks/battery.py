"""Check `battery`: the charge lasts for the route and the way back, and the low-battery voltage is safe."""

from __future__ import annotations

from collections.abc import Iterator

from swarmctl.agent.replan.copter_trajectory import from_takeoff
from swarmctl.agent.replan.decide import first_flight, first_problem, first_route
from swarmctl.agent.traffic.separation.trajectory import Trajectory
from swarmctl.config.scenario import Scenario
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.mission import FlightPlan
from swarmctl.preflight.facts import MAX_AGE_S, Finding, PreflightFacts, without_route

NAME = "battery"
WAIVABLE = True
FULL_PERCENT = 100.0
SIMULATED_ENDURANCE_S = 1400.0
"""flight time of a simulated battery: 6600 mAh at 11.4 V give 1513 s of hover at 179 W; climbs take more"""


def check(facts: PreflightFacts) -> Finding:
    if facts.endurance_s is None:
        remedy = "set preflight.endurance_s to the flight time of a full battery in seconds"
        return Finding(False, "no configured flight time", "a flight time of a full battery", remedy)
    duration_s = flight_s(facts)
    if duration_s is None:
        return Finding(False, *without_route(facts, "a route and the way back"))
    needed_percent = charge_percent(duration_s, facts.endurance_s, facts.reserve_percent)
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
    return Finding(is_enough, f"{percent} %", wanted, "" if is_enough else _advice(needed_percent))


LOW_NAME = "BATT_LOW_VOLT"
"""ArduPilot's voltage of a low battery; the check `parameters` requires a value above 0"""
EMPTY_SHARE = 2.5 / 4.2
"""Voltage of an empty lithium cell of any kind, as a share of a full cell's voltage. BATT_LOW_VOLT has to be
at least this share of the present voltage, for any number of cells."""


def _is_low_voltage_safe(facts: PreflightFacts) -> bool:
    low_v, reported_v = facts.answers.parameters.get(LOW_NAME), facts.state.battery_v
    return low_v is None or (reported_v is not None and low_v >= EMPTY_SHARE * reported_v)


def _unsafe_low_voltage(facts: PreflightFacts) -> tuple[str, str, str]:
    """Return found, wanted and remedy."""
    low, reported_v = f"{LOW_NAME} {facts.answers.parameters[LOW_NAME]:g} V", facts.state.battery_v
    if reported_v is None:
        return f"{low}, no voltage in SYS_STATUS", "a reported voltage", "check the battery monitor"
    wanted = f"{LOW_NAME} {EMPTY_SHARE * reported_v:.1f} V or more, the voltage of an empty lithium battery"
    remedy = f"set {LOW_NAME} to the low voltage of this battery, or check the battery monitor"
    return f"{low} at a voltage of {reported_v:.1f} V", wanted, remedy


def flight_s(facts: PreflightFacts) -> float | None:
    """Return the time of the first route and of a straight return to the present position [s].

    None if the route or the position is unknown.
    """
    state = facts.state
    if facts.trajectory is None or facts.plan is None or state.lat_deg is None or state.lon_deg is None:
        return None
    return out_and_back_s(facts.trajectory, facts.plan, (state.lat_deg, state.lon_deg), facts.spec.speed_m_s)


def out_and_back_s(trajectory: Trajectory, plan: FlightPlan, start: LatLon, speed_m_s: float) -> float:
    """Return the time of a route and of a straight return from its end to `start` [s]."""
    end = (plan.landing.lat_deg, plan.landing.lon_deg)
    return trajectory.times_s[-1] - trajectory.times_s[0] + distance_m(end, start) / speed_m_s


def charge_percent(duration_s: float, endurance_s: float, reserve_percent: float) -> float:
    """Return the charge that a flight needs, as a share of a full battery."""
    return 100.0 * duration_s / endurance_s + reserve_percent


def _advice(needed_percent: float) -> str:
    if needed_percent <= FULL_PERCENT:
        return "charge the battery, or shorten the route"
    keys = "preflight.endurance_s or preflight.reserve_percent"
    return f"a full battery is not enough: shorten the route, or correct {keys}"


def problems(scenario: Scenario) -> Iterator[str]:
    """Yield a line for each vehicle whose first route and way back need more than a full battery."""
    section = scenario.config.preflight
    for spec, task in zip(scenario.specs, scenario.tasks, strict=True):
        endurance_s = section.endurance_s or (SIMULATED_ENDURANCE_S if spec.simulated else None)
        if endurance_s is None:
            continue
        plan = first_flight(task, first_problem(task, scenario.prior), first_route(task, scenario.prior))
        flight = from_takeoff(task, plan, spec.start, task.start_delay_s)
        duration_s = out_and_back_s(flight, plan, spec.start, spec.speed_m_s)
        percent = charge_percent(duration_s, endurance_s, section.reserve_percent)
        if percent > FULL_PERCENT:
            text = f"the first route and the way back take {duration_s:.0f} s and need {percent:.0f} %"
            yield f"{spec.name}: battery: {text} of a battery of {endurance_s:g} s; {_advice(percent)}"
