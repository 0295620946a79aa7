"""Each check passes on a fit vehicle and fails on a single unfit or unknown fact."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from preflight_facts import FIT, FIX, FRAME, SQUARE, START, STATE, flight, place, plan

from swarmctl.config.preflight import Policy
from swarmctl.core.mission import Approach, FlightPlan, Waypoint
from swarmctl.core.records import replace
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.firmware import Firmware
from swarmctl.mavlink.procedures.fence import fence_items
from swarmctl.mavlink.telemetry.instruments import Instruments
from swarmctl.preflight.checks import CHECKS
from swarmctl.preflight.facts import Finding, PreflightFacts
from swarmctl.preflight.policy import DeclaredBehaviour, RequiredParameter, parameters_for


def landing(at_goal: tuple[float, float], at_home: tuple[float, float] | None = None) -> FlightPlan:
    """Return the plan of a fixed wing that lands eastwards, out of a circle of 60 m beside its final."""
    approaches = []
    for touchdown in (at_goal, at_home or place(300.0, 300.0)):
        east_m, north_m = FRAME.to_local(*touchdown)
        final, centre = place(east_m - 100.0, north_m), place(east_m - 160.0, north_m - 60.0)
        low = (Waypoint(*centre, 20.0), 60.0, Waypoint(*final, 20.0), Waypoint(*touchdown, 0.0))
        approaches.append(Approach(*low))
    track = (Waypoint(*place(0.0, 0.0), 40.0), Waypoint(*at_goal, 40.0))
    return FlightPlan(20.0, track, track[-1], approach=approaches[0], home_approach=approaches[1])


def finding(name: str, facts: PreflightFacts) -> Finding:
    (check,) = [c for c in CHECKS if name == c.NAME]
    return check.check(facts)


def but(facts: PreflightFacts = FIT, **changes: Any) -> PreflightFacts:
    """Return facts with other values of their own fields, or of the vehicle's answers or configuration."""
    for part in ("answers", "spec"):
        record = getattr(facts, part)
        named = {name: changes.pop(name) for name in [*changes] if name in record.__struct_fields__}
        facts = replace(facts, **{part: replace(record, **named)})
    return replace(facts, **changes)


def state(**changes: Any) -> PreflightFacts:
    return replace(FIT, state=replace(STATE, **changes))


def gps(**changes: Any) -> PreflightFacts:
    return but(instruments=Instruments(replace(FIX, **changes), 1.8e9, 10.0))


def low_at(low_v: float, *, reported_v: float | None) -> PreflightFacts:
    """Facts of an ArduPilot with this low voltage and this present voltage."""
    parameters = {**FIT.answers.parameters, "BATT_LOW_VOLT": low_v}
    return but(parameters=parameters, state=replace(STATE, battery_v=reported_v))


def other(**changes: Any) -> PreflightFacts:
    other = FIT.others[0]
    configured = {name: changes.pop(name) for name in [*changes] if name in other.spec.__struct_fields__}
    return replace(FIT, others=(replace(other, spec=replace(other.spec, **configured), **changes),))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.NAME)
def test_a_fit_vehicle_passes(check) -> None:
    found = check.check(FIT)
    assert found.ok, found
    assert found.remedy == ""


UNFIT: list[tuple[str, PreflightFacts, str]] = [
    ("identity", but(identity=None), "AUTOPILOT_VERSION"),
    ("identity", but(identity=replace(FIT.identity, sysid=9)), "system 9"),
    ("identity", but(identity=replace(FIT.identity, autopilot=8)), "system 1, ArduPilot"),
    ("identity", but(airframe="plane"), "airframe: copter"),
    ("identity", but(identity=replace(FIT.identity, vehicle_type=1)), "airframe: plane"),
    ("unique", but(sysid_conflict="another sender, at X, uses its system id 1"), "another sender, at X"),
    ("unique", other(sysid=1), "system 1, as uav2"),
    ("unique", other(identity=FIT.identity), "uav2"),
    ("position", but(age_s=float("inf")), "5 s"),
    ("position", but(age_s=9.0), "9 s"),
    ("position", but(position_age_s=9.0), "GLOBAL_POSITION_INT"),
    ("position", but(position_age_s=float("inf")), "GLOBAL_POSITION_INT"),
    ("position", but(status_age_s=9.0), "SYS_STATUS"),
    ("position", but(status_age_s=float("inf")), "SYS_STATUS"),
    ("position", state(lat_deg=None), "GLOBAL_POSITION_INT"),
    ("position", state(ready=False, not_ready=("PreArm: Compass",)), "PreArm: Compass"),
    ("telemetry", but(instruments=Instruments(FIX, 1.8e9, 10.0, position_every_s=2.6)), "2.6 s"),
    ("telemetry", but(instruments=Instruments(FIX, 1.8e9, 10.0)), "2.5 s"),
    ("gps", but(instruments=Instruments(None, None, None)), "GPS_RAW_INT"),
    ("gps", gps(fix_type=2), r"\b2, 9 .*HDOP 1\.20"),
    ("gps", gps(satellites=5), "5 satellites"),
    ("gps", gps(satellites=None), "unknown satellites"),
    ("gps", gps(hdop=2.1), "HDOP 2.10"),
    ("gps", gps(hdop=None), "HDOP unknown"),
    ("home", state(home_lat_deg=None), "HOME_POSITION"),
    ("home", state(home_lat_deg=START[0] + 0.001), "111 m"),
    ("clock", but(clock_offset_s=None), "SYSTEM_TIME"),
    ("clock", but(clock_offset_s=-2.5), "-2.5 s"),
    ("battery", but(endurance_s=None), "preflight.endurance_s"),
    ("battery", state(battery_percent=None), "SYS_STATUS"),
    ("battery", state(battery_percent=38), "38 %"),
    ("battery", but(status_age_s=9.0), r"80 %.* 9 s"),
    ("battery", but(trajectory=None), ""),
    ("battery", low_at(0.1, reported_v=12.6), r"BATT_LOW_VOLT 0\.1 V .*12\.6 V"),
    ("battery", low_at(10.5, reported_v=24.0), r"BATT_LOW_VOLT 10\.5 V .*24\.0 V"),
    ("battery", low_at(10.5, reported_v=None), "BATT_LOW_VOLT 10.5 V"),
    ("parameters", but(no_table_because="no table for X 1.0"), "no table for X 1.0"),
    ("parameters", but(parameters={}), "FENCE_ENABLE"),
    ("parameters", but(parameters={"FENCE_ENABLE": 0.0}), "FENCE_ENABLE 0"),
    ("fence", but(fence_items=None), ""),
    ("fence", but(fence_items=()), r"\b0 .*\b4\b"),
    ("fence", but(fence_items=fence_items(SQUARE[1:] + SQUARE[:1])), "vertex 0"),
    ("fence", but(fence_failure="DO_FENCE_ENABLE: no answer"), "DO_FENCE_ENABLE: no answer"),
    ("rally", but(rally_points=None), ""),
    ("rally", but(rally_points=2), "2 rally points"),
    ("route", but(plan=None), ""),
    ("route", but(plan=plan((0.0, 0.0), (700.0, 300.0), (400.0, 300.0))), "leg 2 of 4"),
    ("route", state(lat_deg=START[0] - 0.01), "leg 1 of 3"),
    ("route", but(plan=plan((0.0, 0.0), up_m=95.0)), "95 m"),
    ("route", but(plan=landing(place(560.0, 300.0))), "at the goal"),
    ("route", but(plan=landing(place(200.0, 200.0), place(-90.0, 0.0))), "at home"),
    ("heading", but(airframe="plane"), "degrees"),
    ("heading", but(airframe="plane", state=replace(STATE, heading_deg=180.0)), "180 degrees"),
    ("heading", but(airframe="plane", plan=None), "verified route"),
    ("heading", but(airframe="plane", state=replace(STATE, lat_deg=None)), "position"),
    ("separation", other(airframe="plane"), r"\b0 m .*uav2 .*\b0 s"),
    ("separation", other(airframe="plane", trajectory=None), "uav2"),
    ("separation", other(altitude_m=42.5), r"\b0 m .*uav2 .*\b0 s"),
    ("separation", other(altitude_m=40.0, trajectory=None), r"uav2\b.* 40 m"),
    ("separation", but(trajectory=None, others=other(altitude_m=40.0).others), "uav1"),
]


@pytest.mark.parametrize(
    ("name", "facts", "value"), UNFIT, ids=[f"{name}: {value[:24]}" for name, _, value in UNFIT]
)
def test_an_unfit_vehicle_fails_with_the_found_value_and_a_cure(
    name: str, facts: PreflightFacts, value: str
) -> None:
    result = finding(name, facts)
    assert not result.ok
    assert re.search(value, f"{result.found}; {result.wanted}; {result.remedy}")
    assert result.found
    assert result.wanted
    assert result.remedy


def test_boards_that_report_the_name_of_their_kind_are_not_one_board() -> None:
    """PX4's BOARD_OVERRIDE_UUID of a Linux board, behind PX4_SOC_ARCH_ID."""
    named = [Identity(n, 12, 2, "PX4 1.15.4", b"\x10\x08MODALAIVOXL20000") for n in (1, 2)]
    facts = replace(but(identity=named[0]), others=other(identity=named[1]).others)
    assert finding("unique", facts).ok


def test_every_check_has_a_row_that_fails() -> None:
    assert {name for name, *_ in UNFIT} == {check.NAME for check in CHECKS}


def test_the_page_has_a_row_for_each_check() -> None:
    page = (Path(__file__).parents[2] / "docs" / "preflight.md").read_text(encoding="utf-8")
    table = page.split("| check | requires |")[1].split("\n\n")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE)) == {check.NAME for check in CHECKS}


def test_a_fixed_wing_with_landings_inside_the_fence_and_along_its_first_leg_passes() -> None:
    stands = replace(STATE, heading_deg=101.0)
    fit = but(airframe="plane", plan=landing(place(300.0, 300.0)), state=stands)
    assert finding("route", fit).ok
    assert finding("heading", fit).ok
    assert finding("identity", replace(fit, identity=replace(FIT.identity, vehicle_type=1))).ok


def test_the_battery_lasts_for_the_route_and_the_way_back_with_a_reserve() -> None:
    # 16 s up, 550 m at 10 m/s, 40 s down, and 540.8 m straight back: 165 s of 900, and 20 % more.
    wanted = finding("battery", FIT).wanted
    assert [int(number) for number in re.findall(r"\d+", wanted)] == [38, 165, 20]
    assert finding("battery", state(battery_percent=39)).ok


def test_the_low_voltage_of_every_kind_of_lithium_battery_is_accepted() -> None:
    # Three cells of lithium polymer (twice), six of lithium ion, four of lithium iron phosphate.
    for low_v, reported_v in ((10.5, 12.6), (10.5, 11.1), (16.8, 25.2), (15.6, 21.6), (11.2, 14.4)):
        assert finding("battery", low_at(low_v, reported_v=reported_v)).ok


def test_routes_at_one_height_may_differ_over_ground_or_in_time() -> None:
    beside = flight((-50.0, -50.0), (400.0, -50.0))
    assert finding("separation", other(altitude_m=40.0, trajectory=beside)).ok
    after = FIT.trajectory.later(400.0)
    assert finding("separation", other(altitude_m=40.0, trajectory=after)).ok


REQUIRED = (
    RequiredParameter("FENCE_ENABLE", "a fence up to 90 m", 1.0, (1.0,)),
    RequiredParameter("FS_GCS_ENABLE", "preflight.policy.lost_link: return", 1.0, (1.0,)),
    RequiredParameter("FS_OPTIONS", "preflight.policy.lost_link: return", bit=1),
    RequiredParameter("AIRSPEED_MIN", "wings.min_speed_m_s: 11", least=0.0, most=11.0),
    RequiredParameter("AIRSPEED_CRUISE", "speed_m_s: 15", least=14.5, most=15.5),
    RequiredParameter("Q_ENABLE", "airframe: plane", values=(0.0,)),
    RequiredParameter("RTL_AUTOLAND", "a return that ends in a landing", 1.0, (1.0,)),
)
RIGHT = {
    "FENCE_ENABLE": 1.0,
    "FS_GCS_ENABLE": 1.0,
    "FS_OPTIONS": 0.0,
    "AIRSPEED_MIN": 9.0,
    "AIRSPEED_CRUISE": 15.0,
    "Q_ENABLE": 0.0,
    "RTL_AUTOLAND": 1.0,
}


BY_PROGRAM, POLICY, WINGS = "preflight.set_parameters: true", "preflight.policy.lost_link", "`wings`"


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"FENCE_ENABLE": 0.0}, {"FENCE_ENABLE", BY_PROGRAM}),
        (
            {"FENCE_ENABLE": 0.0, "FS_GCS_ENABLE": 0.0, "FS_OPTIONS": 2.0},
            {"FENCE_ENABLE", "FS_GCS_ENABLE", "FS_OPTIONS", BY_PROGRAM, POLICY},
        ),
        ({"AIRSPEED_MIN": 13.0}, {"AIRSPEED_MIN", WINGS}),
        ({"AIRSPEED_CRUISE": 20.0}, {"AIRSPEED_CRUISE", "speed_m_s"}),
        ({"Q_ENABLE": 1.0}, {"Q_ENABLE", "airframe"}),
        ({"Q_ENABLE": None}, {"Q_ENABLE"}),
    ],
)
def test_the_cure_names_the_parameters_and_the_settings_that_correct_them(
    wrong: dict[str, float | None], named: set[str]
) -> None:
    reported = {name: value for name, value in (RIGHT | wrong).items() if value is not None}
    found = finding("parameters", but(required_parameters=REQUIRED, parameters=reported))
    assert not found.ok
    settings = {BY_PROGRAM, POLICY, WINGS, "speed_m_s", "airframe"}
    assert {word for word in {*RIGHT, *settings} if word in found.remedy} == named


def test_the_checks_say_which_parameters_fly_sets() -> None:
    """A plane with a landing in its mission refuses to arm by a parameter that `fly` sets before arming."""
    reported = RIGHT | {"RTL_AUTOLAND": 0.0, "Q_ENABLE": 1.0}
    texts = ("DO_LAND_START set and RTL_AUTOLAND disabled", "Compass not calibrated")
    plane = but(required_parameters=REQUIRED, parameters=reported, may_set_parameters=True)
    unready = replace(STATE, ready=False, not_ready=texts[:1])
    before_fly = replace(plane, fly_sets={"RTL_AUTOLAND": 1.0}, state=unready)
    position = finding("position", before_fly)
    assert (position.ok, position.set_by_fly) == (False, True)
    assert "RTL_AUTOLAND 0 → 1" in position.remedy
    two_reasons = replace(unready, not_ready=("; ".join(texts),))
    assert not finding("position", replace(before_fly, state=two_reasons)).set_by_fly
    for facts in (before_fly, plane):
        found = finding("parameters", facts)
        assert (found.ok, found.set_by_fly) == (False, False)
        assert all(name in found.remedy for name in ("RTL_AUTOLAND", "Q_ENABLE"))
        assert BY_PROGRAM not in found.remedy


def test_a_parameter_that_a_firmware_has_and_does_not_report_fails() -> None:
    """A PX4 sends no answer for a name that it lacks; a lost answer looks the same."""
    behaviour = DeclaredBehaviour(Policy(lost_link="return"), gcs_sysid=255, altitude_m=40.0, ceiling_m=90.0)
    required = parameters_for(Firmware("PX4", (1, 16)), behaviour)
    of_the_link = but(required_parameters=tuple(r for r in required if "lost_link" in r.declared))
    reported = {"NAV_DLL_ACT": 2.0, "COM_DL_LOSS_T": 10.0}
    found = finding("parameters", but(of_the_link, parameters=reported))
    assert not found.ok
    assert found.found.startswith("COM_DLL_EXCEPT ")
    assert "COM_DLL_EXCEPT" in found.remedy
    for value, ok in ((0.0, True), (6.0, True), (1.0, False)):
        complete = but(of_the_link, parameters=reported | {"COM_DLL_EXCEPT": value})
        assert finding("parameters", complete).ok is ok
