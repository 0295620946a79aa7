"""Each check passes on a vehicle that is fit, and fails on one thing at a time; what is not known fails."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from preflight_facts import FIT, FIX, FRAME, SQUARE, START, STATE, flight, place, plan

from swarmctl.config.preflight import Policy
from swarmctl.core.mission import Approach, FlightPlan, Waypoint
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.firmware import Firmware
from swarmctl.mavlink.procedures.fence import fence_items
from swarmctl.mavlink.telemetry.instruments import Instruments
from swarmctl.preflight.checks import CHECKS
from swarmctl.preflight.facts import Finding, PreflightFacts
from swarmctl.preflight.policy import DeclaredBehaviour, NoParameterTable, RequiredParameter, parameters_for


def landing(at_goal: tuple[float, float], at_home: tuple[float, float] | None = None) -> FlightPlan:
    """Of a fixed wing that lands flying east, out of a circle of 60 m beside the begin of its final."""
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


def but(**changes: Any) -> PreflightFacts:
    return replace(FIT, **changes)


def state(**changes: Any) -> PreflightFacts:
    return replace(FIT, state=replace(STATE, **changes))


def gps(**changes: Any) -> PreflightFacts:
    return replace(FIT, instruments=Instruments(replace(FIX, **changes), 1.8e9, 10.0))


def low_at(low_v: float, *, told_v: float | None) -> PreflightFacts:
    """An ArduPilot whose voltage counts as low at `low_v`."""
    parameters = {**FIT.parameters, "BATT_LOW_VOLT": low_v}
    return replace(FIT, parameters=parameters, state=replace(STATE, battery_v=told_v))


def other(**changes: Any) -> PreflightFacts:
    return replace(FIT, others=(replace(FIT.others[0], **changes),))


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.NAME)
def test_a_fit_vehicle_passes(check) -> None:
    found = check.check(FIT)
    assert found.ok, found
    assert found.cure == ""


UNFIT: list[tuple[str, PreflightFacts, str]] = [
    ("identity", but(identity=None), "has not said who it is"),
    ("identity", but(identity=replace(FIT.identity, sysid=9)), "system 9"),
    ("identity", but(identity=replace(FIT.identity, autopilot=8)), "system 1, ArduPilot"),
    ("identity", but(airframe="plane"), "system 1, ArduPilot 4.6.2, a copter"),
    ("identity", but(identity=replace(FIT.identity, vehicle_type=1)), "system 1, ArduPilot 4.6.2, a plane"),
    ("unique", but(conflict="another sender, at X, uses its system id 1"), "another sender, at X"),
    ("unique", other(sysid=1), "system 1, as uav2"),
    ("unique", other(identity=FIT.identity), "the same autopilot as uav2"),
    ("position", but(age_s=float("inf")), "never heard"),
    ("position", but(age_s=9.0), "last heard 9 s ago"),
    ("position", but(position_age_s=9.0), "tells no position"),
    ("position", but(position_age_s=float("inf")), "tells no position"),
    ("position", but(status_age_s=9.0), "told too long ago"),
    ("position", but(status_age_s=float("inf")), "told too long ago, or never"),
    ("position", state(lat_deg=None), "tells no position"),
    ("position", state(ready=False, not_ready=("PreArm: Compass",)), "not ready to arm: PreArm: Compass"),
    ("telemetry", but(instruments=Instruments(FIX, 1.8e9, 10.0, position_every_s=2.6)), "one every 2.6 s"),
    ("telemetry", but(instruments=Instruments(FIX, 1.8e9, 10.0)), "hardly a position came"),
    ("gps", but(instruments=None), "did not come"),
    ("gps", but(instruments=Instruments(None, None, None)), "did not come"),
    ("gps", gps(fix_type=2), "fix type 2, 9 satellites, HDOP 1.20"),
    ("gps", gps(satellites=5), "5 satellites"),
    ("gps", gps(satellites=None), "unknown satellites"),
    ("gps", gps(hdop=2.1), "HDOP 2.10"),
    ("gps", gps(hdop=None), "HDOP unknown"),
    ("home", state(home_lat_deg=None), "it has none"),
    ("home", state(home_lat_deg=START[0] + 0.001), "home 111 m away"),
    ("clock", but(clock_offset_s=None), "tells no time of day"),
    ("clock", but(clock_offset_s=-2.5), "-2.5 s"),
    ("battery", but(endurance_s=None), "nobody has said how long it flies"),
    ("battery", state(battery_percent=None), "does not tell its charge"),
    ("battery", state(battery_percent=38), "38 %"),
    ("battery", but(status_age_s=9.0), "80 %, as told 9 s ago"),
    ("battery", but(flight=None), "no verified route"),
    ("battery", low_at(0.1, told_v=12.6), "low at 0.1 V, and 12.6 V are told"),
    ("battery", low_at(10.5, told_v=24.0), "low at 10.5 V, and 24.0 V are told"),
    ("battery", low_at(10.5, told_v=None), "low at 10.5 V, and no voltage is told"),
    ("parameters", but(no_table="no table for X 1.0"), "no table for X 1.0"),
    ("parameters", but(parameters={}), "FENCE_ENABLE not told"),
    ("parameters", but(parameters={"FENCE_ENABLE": 0.0}), "FENCE_ENABLE 0"),
    ("fence", but(fence_items=None), "could not be read"),
    ("fence", but(fence_items=()), "0 items instead of 4"),
    ("fence", but(fence_items=fence_items(SQUARE[1:] + SQUARE[:1])), "vertex 0"),
    ("fence", but(fence_failure="DO_FENCE_ENABLE: no answer"), "DO_FENCE_ENABLE: no answer"),
    ("rally", but(rally_points=None), "whether it has some is not known"),
    ("rally", but(rally_points=2), "2 rally points"),
    ("route", but(plan=None), "no verified route"),
    ("route", but(plan=plan((0.0, 0.0), (700.0, 300.0), (400.0, 300.0))), "leg 2 of 4 leaves the fence"),
    ("route", state(lat_deg=START[0] - 0.01), "leg 1 of 3 leaves the fence"),
    ("route", but(plan=plan((0.0, 0.0), up_m=95.0)), "climbs to 95 m"),
    ("route", but(plan=landing(place(560.0, 300.0))), "its landing at its goal leaves the fence"),
    ("route", but(plan=landing(place(200.0, 200.0), place(-90.0, 0.0))), "its landing at home leaves"),
    ("heading", but(airframe="plane"), "does not tell how it stands"),
    ("heading", but(airframe="plane", state=replace(STATE, heading_deg=180.0)), "180 degrees"),
    ("heading", but(airframe="plane", plan=None), "no verified route"),
    ("separation", other(airframe="plane"), "0 m over ground from uav2 after 0 s"),
    ("separation", other(airframe="plane", flight=None), "uav2 flies too, and where is not known"),
    ("separation", other(altitude_m=42.5), "0 m over ground from uav2 after 0 s"),
    ("separation", other(altitude_m=40.0, flight=None), "uav2 flies at 40 m too, and where is not known"),
    ("separation", but(flight=None, others=(replace(FIT.others[0], altitude_m=40.0),)), "not known here"),
]


@pytest.mark.parametrize(
    ("name", "facts", "found"), UNFIT, ids=[f"{name}: {found[:24]}" for name, _, found in UNFIT]
)
def test_an_unfit_vehicle_fails_with_what_was_found_and_what_to_do(name, facts, found) -> None:
    result = finding(name, facts)
    assert not result.ok
    assert found in result.found
    assert result.wanted
    assert result.cure


def test_boards_that_tell_the_name_of_their_kind_are_not_one_board() -> None:
    """PX4's BOARD_OVERRIDE_UUID of a Linux board, behind PX4_SOC_ARCH_ID."""
    named = [Identity(n, 12, 2, "PX4 1.15.4", b"\x10\x08MODALAIVOXL20000") for n in (1, 2)]
    facts = replace(but(identity=named[0]), others=other(identity=named[1]).others)
    assert finding("unique", facts).ok


def test_every_check_has_a_row_that_it_fails() -> None:
    assert {name for name, *_ in UNFIT} == {check.NAME for check in CHECKS}


def test_a_fixed_wing_whose_landings_are_inside_and_that_stands_along_its_first_leg_may_go() -> None:
    stands = replace(STATE, heading_deg=101.0)
    fit = replace(FIT, airframe="plane", plan=landing(place(300.0, 300.0)), state=stands)
    assert finding("route", fit).ok
    assert finding("heading", fit).ok
    assert finding("identity", replace(fit, identity=replace(FIT.identity, vehicle_type=1))).ok


def test_battery_for_the_way_there_and_back_with_a_reserve() -> None:
    # 16 s up, 550 m at 10 m/s, 40 s down, and 540.8 m straight back: 165 s of 900, and 20 % more.
    assert finding("battery", FIT).wanted == "38 %: 165 s there and back, 20 % in reserve"
    assert finding("battery", state(battery_percent=39)).ok


def test_any_lithium_battery_may_be_low_where_its_maker_says() -> None:
    # Three cells of lithium polymer, six of lithium ion, four of lithium iron phosphate, full or half so.
    for low_v, told_v in ((10.5, 12.6), (10.5, 11.1), (16.8, 25.2), (15.6, 21.6), (11.2, 14.4)):
        assert finding("battery", low_at(low_v, told_v=told_v)).ok


def test_routes_at_one_height_may_be_apart_over_ground_or_in_time() -> None:
    beside = flight((-50.0, -50.0), (400.0, -50.0))
    assert finding("separation", other(altitude_m=40.0, flight=beside)).ok
    after = FIT.flight.later(400.0)
    assert finding("separation", other(altitude_m=40.0, flight=after)).ok


CURED = (
    RequiredParameter("FENCE_ENABLE", "a fence up to 90 m", 1.0, (1.0,)),
    RequiredParameter("FS_GCS_ENABLE", "policy.lost_link: return", 1.0, (1.0,)),
    RequiredParameter("FS_OPTIONS", "policy.lost_link: return", bit=1),
    RequiredParameter("AIRSPEED_MIN", "wings.min_speed_m_s: 11", least=0.0, most=11.0),
    RequiredParameter("AIRSPEED_CRUISE", "speed_m_s: 15", least=14.5, most=15.5),
    RequiredParameter("Q_ENABLE", "airframe: plane", values=(0.0,)),
)
RIGHT = {
    "FENCE_ENABLE": 1.0,
    "FS_GCS_ENABLE": 1.0,
    "FS_OPTIONS": 0.0,
    "AIRSPEED_MIN": 9.0,
    "AIRSPEED_CRUISE": 15.0,
    "Q_ENABLE": 0.0,
}


@pytest.mark.parametrize(
    ("wrong", "cure"),
    [
        ({"FENCE_ENABLE": 0.0}, "set FENCE_ENABLE there, or preflight.set_parameters: true"),
        (
            {"FENCE_ENABLE": 0.0, "FS_GCS_ENABLE": 0.0, "FS_OPTIONS": 2.0},
            "set FENCE_ENABLE, FS_GCS_ENABLE and FS_OPTIONS there, or preflight.set_parameters: true; "
            "or declare another policy",
        ),
        ({"AIRSPEED_MIN": 13.0}, "set AIRSPEED_MIN there yourself; or correct `wings`"),
        (
            {"AIRSPEED_CRUISE": 20.0},
            "set AIRSPEED_CRUISE there yourself; or correct speed_m_s of the vehicle",
        ),
        ({"Q_ENABLE": 1.0}, "set Q_ENABLE there yourself; or correct airframe of the vehicle"),
        ({"Q_ENABLE": None}, "see why it does not tell Q_ENABLE: its link, or a firmware built without"),
    ],
)
def test_who_can_mend_a_parameter_is_said(wrong: dict[str, float | None], cure: str) -> None:
    told = {name: value for name, value in (RIGHT | wrong).items() if value is not None}
    found = finding("parameters", but(wanted=CURED, parameters=told))
    assert not found.ok
    assert found.cure == cure


def test_what_to_do_about_a_firmware_that_nobody_knows_is_said() -> None:
    intent = DeclaredBehaviour(Policy(), gcs_sysid=255, altitude_m=40.0, ceiling_m=90.0)
    with pytest.raises(NoParameterTable) as nobody:
        parameters_for(Firmware("PX4", (1, 17)), intent)
    found = finding("parameters", but(no_table=str(nobody.value)))
    assert found.found.startswith("no table for PX4 1.17; there is one for ArduCopter 4.5 to 4.7, ")
    assert found.cure.startswith("fly another version or declare another policy; or see yourself to what it")
    assert found.cure.endswith("and waive this by name")


def test_what_a_firmware_has_and_does_not_tell_is_not_taken_as_lacking() -> None:
    """A PX4 answers nothing for a name that it lacks, as where the answer is lost."""
    intent = DeclaredBehaviour(Policy(lost_link="return"), gcs_sysid=255, altitude_m=40.0, ceiling_m=90.0)
    asked = parameters_for(Firmware("PX4", (1, 16)), intent)
    of_the_link = but(wanted=tuple(w for w in asked if "lost_link" in w.declared))
    told = {"NAV_DLL_ACT": 2.0, "COM_DL_LOSS_T": 10.0}
    found = finding("parameters", replace(of_the_link, parameters=told))
    assert (found.ok, found.found) == (False, "COM_DLL_EXCEPT not told")
    assert "see why it does not tell COM_DLL_EXCEPT: its link, or" in found.cure
    for value, ok in ((0.0, True), (6.0, True), (1.0, False)):
        assert (
            finding("parameters", replace(of_the_link, parameters=told | {"COM_DLL_EXCEPT": value})).ok is ok
        )


def test_who_is_as_declared_needs_no_cure() -> None:
    assert finding("parameters", but(wanted=CURED, parameters=RIGHT)).ok
