"""Scenario files and URLs: accepted forms, and errors with their place."""

import json
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.physics.geodesy import LocalFrame
from sim_vehicle.scenarios import Scenario, ScenarioError, default_scenario, load_scenario
from sim_vehicle.scenarios.checks import CHECKS
from sim_vehicle.scenarios.command import shipped
from sim_vehicle.scenarios.file import parse_scenario
from sim_vehicle.scenarios.plan import Leg, PlanWriter
from sim_vehicle.scenarios.schema import file_schema
from sim_vehicle.scenarios.steps import ScriptStep

HOME = "home: {lat_deg: 46.0, lon_deg: 14.5, alt_amsl_m: 300}\n"
MIXED = "vehicles: [{}, {personality: px4}]\n"
AREA = "area: {origin_lat_deg: 46, origin_lon_deg: 14.5, rows: 20, cols: 20, cell_size_m: 50}\n"
THREATS = HOME + "count: 1\n" + AREA + "firing_strength: [0.6, 0.3, 0.1]\n"


def from_yaml(tmp_path: Path, text: str) -> Scenario:
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return load_scenario(path)


def refused(tmp_path: Path, text: str) -> list[str]:
    """Return the lines of the error, without the folder."""
    with pytest.raises(ScenarioError) as caught:
        from_yaml(tmp_path, text)
    return str(caught.value).replace(f"{tmp_path}/", "").splitlines()


def place_m(scenario: Scenario, index: int) -> tuple[float, float]:
    """Return the position of a vehicle east and north of 46 N, 14.5 E [m]."""
    spec = scenario.vehicles[index]
    return LocalFrame(46.0, 14.5).point_to_local(spec.lat_deg, spec.lon_deg)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("{", "scenario.json:1: "),
        ('{\n\t"count": 1,\n\t"seed": -1\n}', "scenario.json:3: seed: "),
        ("[" * 100_000, "scenario.json:1: "),
        ('{"seed": ' + "1" * 5000 + "}", "scenario.json:1: "),
    ],
    ids=["not closed", "tabs", "deep", "long number"],
)
def test_errors_in_json_have_their_lines(text: str, found: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(text, "scenario.json")
    assert found in str(caught.value)


@pytest.mark.parametrize(
    "value",
    ["2026-13-01", "!!int x", "!!bool x", "!!timestamp x", "1:" * 200 + "1.0", "1" * 5000],
    ids=["date", "int", "bool", "timestamp", "too large", "too long"],
)
def test_a_value_that_does_not_fit_its_type_has_its_line(tmp_path: Path, value: str) -> None:
    (found,) = refused(tmp_path, f"{HOME}count: 1\nabout: {value}\n")
    assert found.startswith("scenario.yaml:3: "), found
    assert "is not a valid" in found


def test_a_merge_key_adds_the_values_of_an_anchor(tmp_path: Path) -> None:
    scenario = from_yaml(tmp_path, f"{HOME}vehicles: [&first {{personality: px4}}, {{<<: *first}}]\n")
    assert [vehicle.personality for vehicle in scenario.vehicles] == ["px4", "px4"]


def test_a_small_number_in_json_is_a_number() -> None:
    text = '{"home": {"lat_deg": 1e-07, "lon_deg": 14.5}, "count": 1, "about": "\\ud83d\\ude00"}'
    scenario = parse_scenario(text, "scenario.json")
    assert scenario.vehicles[0].lat_deg == pytest.approx(1e-7)
    assert scenario.about == "\N{GRINNING FACE}"


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"nothing\.json: "):
        load_scenario(tmp_path / "nothing.json")


# -- YAML: short forms -----------------------------------------------------------------------------------


def test_a_count_alone_is_a_scenario(tmp_path: Path) -> None:
    scenario = from_yaml(tmp_path, HOME + "count: 3")
    assert [v.sysid for v in scenario.vehicles] == [1, 2, 3]
    assert [round(place_m(scenario, i)[0], 3) for i in range(3)] == [0.0, 5.0, 10.0]
    assert {v.alt_amsl_m for v in scenario.vehicles} == {300.0}
    assert scenario.name == "scenario"


def test_vehicles_are_placed_in_metres_from_home_and_numbered(tmp_path: Path) -> None:
    scenario = from_yaml(
        tmp_path,
        HOME
        + """
vehicles:
  - {count: 2, spacing_m: 30, north_m: -40, personality: px4}
  - {sysid: 9, east_m: 7}
  - {type: plane}
  - {lat_deg: 46.3, lon_deg: 14.5}
""",
    )
    assert [v.sysid for v in scenario.vehicles] == [1, 2, 9, 10, 11]
    assert [v.personality for v in scenario.vehicles[:3]] == ["px4", "px4", "ardupilot"]
    assert scenario.vehicles[3].kind == "plane"
    assert place_m(scenario, 1) == pytest.approx((30, -40), abs=1e-3)
    assert place_m(scenario, 2) == pytest.approx((7, 0), abs=1e-3)
    assert scenario.vehicles[4].lat_deg == pytest.approx(46.3)


def test_more_than_250_vehicles_use_the_next_link(tmp_path: Path) -> None:
    for scenario in (
        from_yaml(tmp_path, HOME + "count: 600"),
        default_scenario(600, home=(46.0, 14.5, 10.0)),
    ):
        assert Counter(v.link for v in scenario.vehicles) == {0: 250, 1: 250, 2: 100}
        assert len({(v.link, v.sysid) for v in scenario.vehicles}) == 600
        assert max(v.sysid for v in scenario.vehicles) == 250


def test_one_mission_serves_several_vehicles_around_their_starts(tmp_path: Path) -> None:
    scenario = from_yaml(
        tmp_path,
        HOME
        + """
vehicles:
  - mission: &there
      - takeoff: 20
      - speed_m_s: 4
      - waypoint: {east_m: 30, north_m: 40, height_m: 25, hold_s: 2}
      - jump: {to: 3, times: 2}
      - land
  - {personality: px4, east_m: 100, mission: *there}
""",
    )
    for spec, first, relative in zip(scenario.vehicles, (1, 0), (True, False), strict=True):
        items = PlanWriter(spec.lat_deg, spec.lon_deg).mission(spec.mission, home_first=relative)
        assert len(items) == 5 + first
        waypoint, jump, land = items[first + 2], items[first + 3], items[first + 4]
        there = LocalFrame(spec.lat_deg, spec.lon_deg).point_to_local(waypoint.x * 1e-7, waypoint.y * 1e-7)
        assert there == pytest.approx((30, 40), abs=0.02)
        assert (waypoint.z, waypoint.params[0]) == (25, 2)
        assert jump.params[0] == first + 2  # the waypoint
        assert land.command == mavlink.MAV_CMD_NAV_LAND
        assert (land.x, land.y) == (waypoint.x, waypoint.y)
        assert spec.goal_m() == (30, 40)


def test_a_loaded_scenario_survives_serialisation(tmp_path: Path) -> None:
    scenario = from_yaml(
        tmp_path,
        HOME
        + """
vehicles:
  - {count: 2, mission: [{takeoff: 5}, rtl], fence: [{keep_in_circle: {east_m: 0, north_m: 0, radius_m: 50}}]}
script: [fly_mission, {at_s: 3, mode: RTL}, {param: {RTL_ALT: 3000}, expect: any}]
checks: [no_crash, min_separation_m: 5, mode_is: {mode: RTL, by_s: 5}]
faults: ["gps_loss:at=3"]
""",
    )
    assert Scenario.model_validate(scenario.model_dump()) == scenario
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


# -- YAML: errors ----------------------------------------------------------------------------------------


def test_all_mistakes_are_reported_at_once_with_line_and_correction(tmp_path: Path) -> None:
    lines = refused(
        tmp_path,
        HOME
        + """vehicles:
  - count: 3
    mission:
      - takeoff: 20
      - waypont: {east_m: 0}
      - {land: , rtl: }
  - {north_m: 50, personality: arduplane}
chekcs: []
checks:
  - no_crsh
  - min_separation_m
  - landed: {by: 3}
faults: [packet_los]
""",
    )
    assert [line.split(": ")[0] for line in lines] == [
        f"scenario.yaml:{number}" for number in (6, 7, 8, 9, 11, 12, 13, 14)
    ]
    text = "\n".join(lines)
    assert "`waypoint`" in text
    assert "land and rtl" in text
    assert "'ardupilot' or 'px4'" in text
    assert "`checks`" in text
    assert "did you mean `no_crash`?" in text
    assert "min_separation_m.metres: is missing" in text
    assert "landed.by: unknown key; did you mean `by_s`?" in text
    assert "packet_loss?" in text
    assert "[fault-name]" in text


@pytest.mark.parametrize(
    ("text", "line", "found"),
    [
        ("", 1, "`vehicles`"),
        ("just words", 1, "'just words'"),
        ("count: 1\ncount: 2", 2, "key 'count' is a duplicate of line 1"),
        ("count: &a [*a]", 1, ""),
        ("a: [", 1, "YAML"),
        ("count: 1\nseed\nspeedup: 1", 2, "YAML"),
        (HOME + "count: 0", 2, "count: must be at least 1, found 0"),
        ("count: 2", 1, "`home`"),
        ("home: {lat_deg: 91, lon_deg: 0}\ncount: 1", 1, "home.lat_deg: must be at most 89, found 91"),
        (HOME + "count: 1\nvehicles: [{}]", 2, "count: "),
        (HOME + "vehicles:\n  - {lat_deg: 46, lon_deg: 14, east_m: 3}", 3, "0.east_m: "),
        (HOME + "count: 1\nscript:\n  - {mode: HOVER}", 4, "script.0: mode: "),
        (HOME + "count: 1\nscript:\n  - {param: {FOO: 1}}", 4, "script.0: param: "),
        (HOME + "count: 1\nscript: [fly_mission]", 3, "script.0: fly_mission: vehicle 1 has no `mission`"),
        (HOME + "count: 1\nscript: [{mode: RTL, vehicles: [2]}]", 3, "[2]"),
        (HOME + "count: 1\nchecks: [reached_goal]", 3, "`goal`"),
        (HOME + "count: 1\nchecks: [no_fence_breach]", 3, "`fence`"),
        (HOME + "count: 1\nchecks: [stays_in_area]", 3, "`area`"),
        (HOME + "count: 1\nchecks: [{no_crash: 5}]", 3, "(vehicles, when, "),
        (HOME + "count: 1\nchecks: [{mode_is: 5}]", 3, "checks.0.mode_is.mode: must be text, found 5"),
        (HOME + "count: 1\nchecks: [{no_crash: {by_s: 5}}]", 3, "`by_s`"),
        (HOME + "count: 1\nwind: {speed_m_s: '7'}", 3, "wind.speed_m_s: must be a number, found '7'"),
        # vehicles and threats
        (HOME + "vehicles: []", 2, "vehicles: "),
        (HOME + "vehicles: [{sysid: 1}, {sysid: 1}]", 2, "vehicles: system ids on one link must differ"),
        (HOME + "vehicles: [{sysid: 0}]", 2, "vehicles.0.sysid"),
        (HOME + "vehicles: [{params: {WPNAV_SPED: 1}}]", 2, "ardupilot copter: WPNAV_SPED;"),
        (HOME + "vehicles: [{personality: px4, params: {WPNAV_SPEED: 1}}]", 2, "px4 copter: WPNAV_SPEED;"),
        (HOME + "count: 1\nfiring_strength: [0.3, 0.3, 0.1]", 3, "firing_strength: "),
        (THREATS + "hostiles: [[20, 0]]", 5, "[(20, 0)]"),
        (THREATS + "hostiles: [[1, 1], [1, 1]]", 5, "[(1, 1)]"),
        (HOME + "count: 1\nhostiles: [[3, 4]]", 3, "`area`"),
        # types
        (HOME + "count: 1\nwind: 5", 3,
         "wind: must be a section with keys (speed_m_s, from_deg, gust_m_s), found 5"),
        (HOME + "count: 1\nfaults: motor_loss", 3,
         "found 'motor_loss'"),
        (HOME + "count: 1\nscript: [takeoff]", 3, "script.0.takeoff: "),
        (HOME + "count: 1\nscript: [rtl: 5]", 3, "script.0.rtl: "),
        (HOME + "count: 1\nscript: [heartbeat: 5]", 3, "script.0.heartbeat: must be true or false, found 5"),
        (HOME + "count: 1\nname: a/b", 3, "name: "),
        # times after the end of the run
        (HOME + "count: 1\nuntil_s: 60\nchecks:\n- max_height_m: {metres: 1, from_s: 60}", 5,
         "checks.0: max_height_m: `from_s` (60 s)"),
        (HOME + "count: 1\nuntil_s: 60\nchecks:\n- no_crash\n- alive: {from_s: 5, until_s: 61}", 6,
         "alive: `until_s` (61 s)"),
        (HOME + "count: 1\nuntil_s: 10\nchecks: [landed: {by_s: 50}]", 4, "landed: `by_s` (50 s)"),
        (HOME + "count: 1\nchecks: [mode_is: {mode: LAND, when: always, from_s: 600}]", 3,
         "`until_s` (600 s)"),
        (HOME + "count: 1\nuntil_s: 10\nscript:\n  - {at_s: 90, arm: }", 5, "arm: `at_s` (90 s)"),
        (HOME + "count: 1\nuntil_s: 10\nfaults: ['gps_loss:at=50']", 4, "gps_loss: `at_s` (50 s)"),
        (HOME + "count: 1\nchecks: [airborne: {from_s: 40, by_s: 20}]", 3,
         "`by_s` (20)"),
        (HOME + "count: 1\nchecks: [disarmed: {from_s: 5}]", 3, "`from_s` to `until_s`"),
        (HOME + "count: 1\nchecks: [disarmed: {until_s: 5}]", 3, "`from_s` to `until_s`"),
        # checks that nothing could fail
        (HOME + "count: 1\nchecks: [no_strike]", 3, "no_strike needs the scenario's `hostiles`"),
        (HOME + "count: 1\nchecks: [strikes_at_most: 0]", 3, "strikes_at_most needs the scenario's"),
        (HOME + "count: 1\nchecks: [min_separation_m: 5]", 3, "min_separation_m"),
        (HOME + "count: 2\nchecks: [min_separation_m: -5]", 3, "metres: must be at least 0.1, found -5"),
        (HOME + "count: 1\nchecks: [max_height_m: .nan]", 3, "metres: must be a finite number, found nan"),
        (HOME + "count: 1\nchecks: [max_height_m: .inf]", 3, "metres: must be a finite number, found inf"),
        (HOME + "count: 1\nchecks: [battery_above: 30]", 3, "share: must be at most 1, found 30"),
        (HOME + "count: 1\nchecks: [never_says: '']", 3, "words: must have a visible character, found ''"),
        (HOME + "count: 1\nchecks: [heard_text: ' ']", 3, "words: must have a visible character, found ' '"),
        # unknown names
        (HOME + "count: 1\nchecks: [mode_is: RLT]", 3, "did you mean `RTL`?"),
        (HOME + MIXED + "checks: [mode_is: RTL|Retrun]", 3, "did you mean `Return`?"),
        (HOME + MIXED + "checks: [mode_is: RTL]", 3, "px4 copter has no mode 'RTL'"),
        (HOME + "count: 1\nscript: [mode: RTL|Retrun]", 3, "'Retrun'"),
        (HOME + "count: 1\nscript: [command: {command: ENUM_END}]", 3, "command.command: 'ENUM_END'"),
        (HOME + "count: 1\nscript: [command: {command: 70000}]", 3, "from 0 to 65535, found 70000"),
        (HOME + "vehicles: [{mission: [item: {command: MAV_CMD_ENUM_END}]}]", 2, "command: 'MAV_CMD_ENUM"),
        # plans that cannot be flown
        (HOME + "vehicles:\n  - mission:\n    - takeoff: 10\n    - jump: {to: 9}", 5,
         "vehicles.0.mission.1: jump: "),
        (HOME + "vehicles:\n  - mission:\n    - jump: {to: 1, times: 2}", 3, "vehicles.0.mission: "),
        (HOME + "vehicles:\n- mission:\n  - takeoff: 9\n  - speed_m_s: 5\n  - jump: {to: 2, times: -1}", 6,
         "vehicles.0.mission.2: jump: "),
        (HOME + "vehicles: [{count: 3, fence: [keep_in: [[0, 0], [1, 1], [20, 20]]]}]", 2, "0.fence.0"),
        (HOME + "vehicles: [{fence: [keep_out: [[5, 5], [5, 5], [5, 5]]]}]", 2, "vehicles.0.fence.0"),
        (HOME + "vehicles:\n- {east_m: 0}\n- {east_m: 60000}", 4, "vehicles.1: starts 60 km"),
    ],
)  # fmt: skip
def test_a_mistake_has_its_line_and_key(tmp_path: Path, text: str, line: int, found: str) -> None:
    lines = refused(tmp_path, text)
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"scenario.yaml:{line}: ")
    assert found in lines[0]


def test_equal_mistakes_of_counted_vehicles_are_reported_once(tmp_path: Path) -> None:
    lines = refused(tmp_path, HOME + "vehicles: [{count: 30, mission: [{takeoff: 5}, {jump: {to: 7}}]}]")
    assert len(lines) == 1, lines


@pytest.mark.parametrize(
    "text",
    [
        "count: 1\nuntil_s: 60\nchecks: [landed: {by_s: 60}, alive: {from_s: 59, until_s: 60}]",
        MIXED + "checks: [mode_is: RTL|Return, mode_is: {mode: rtl, vehicles: [1]}]",
        "vehicles: [{personality: px4}]\nchecks: [mode_is: Termination]",
        "vehicles: [{mission: [{takeoff: 5}, {jump: {to: 1, times: -1}}]}]",
        "vehicles: [{mission: [{item: {command: DO_JUMP, param1: 99, param2: -1}}]}]",
        "vehicles: [{mission: [{item: {command: 65000}}]}]",
        "vehicles: [{fence: [keep_in: [[-9, -9], [9, 9], [9, -9], [-9, 9]]]}]",
        "count: 2\nchecks: [min_separation_m: {metres: 5, vehicles: [1]}]",
    ],
)
def test_valid_checks_and_plans_are_accepted(tmp_path: Path, text: str) -> None:
    assert from_yaml(tmp_path, HOME + text).vehicles


def test_a_served_fleet_accepts_late_faults() -> None:
    data = default_scenario(1, home=(46.0, 14.5, 10.0)).model_dump()
    late = Scenario.model_validate({**data, "faults": ["gps_loss:at=5000"]})
    assert late.faults[0].at_s > late.until_s


def test_the_goal_is_the_last_position_of_the_mission(tmp_path: Path) -> None:
    scenario = from_yaml(
        tmp_path,
        HOME
        + """
vehicles:
  - mission: &looks
      - takeoff: 20
      - waypoint: {east_m: 30, north_m: 40, height_m: 25}
      - item: {command: DO_SET_ROI_LOCATION, east_m: 500, north_m: 500}
      - rtl
  - {personality: px4, mission: *looks}
  - {mission: *looks, goal: {east_m: 1, north_m: 2}}
""",
    )
    assert [v.goal_m() for v in scenario.vehicles] == [(30, 40), (30, 40), (1, 2)]
    assert [v.goal_item() for v in scenario.vehicles] == [2, 1, None]


def test_a_mixed_fleet_alternates_between_the_autopilots_in_a_row() -> None:
    mixed = default_scenario(4, home=(46.0, 14.5, 10.0), personality="mixed")
    assert [v.personality for v in mixed.vehicles] == ["ardupilot", "px4", "ardupilot", "px4"]
    assert [round(place_m(mixed, i)[0], 2) for i in range(4)] == [0, 5, 10, 15]


# -- the schema ------------------------------------------------------------------------------------------


def holds(data: Any, schema: Any, kinds: dict[str, Any]) -> bool:
    """Evaluate the part of JSON schema that the printed schema uses."""
    types: dict[str, Any] = {
        "object": dict,
        "array": list,
        "string": str,
        "number": (int, float),
        "integer": int,
        "boolean": bool,
        "null": type(None),
    }
    if "$ref" in schema and not holds(data, kinds[schema["$ref"].split("/")[-1]], kinds):
        return False
    number = isinstance(data, int | float) and not isinstance(data, bool)
    fits = [
        "type" not in schema
        or (isinstance(data, types[schema["type"]]) and (data is not True or schema["type"] == "boolean")),
        "enum" not in schema or data in schema["enum"],
        "anyOf" not in schema or any(holds(data, one, kinds) for one in schema["anyOf"]),
        "oneOf" not in schema or sum(holds(data, one, kinds) for one in schema["oneOf"]) == 1,
    ]  # fmt: skip
    if number:
        fits += [data >= schema.get("minimum", data), data <= schema.get("maximum", data)]
        fits += [data > schema.get("exclusiveMinimum", data - 1)]
    if isinstance(data, dict):
        known = schema.get("properties", {})
        fits += [set(schema.get("required", [])) <= set(data), len(data) <= schema.get("maxProperties", 99)]
        fits += [holds(value, known[key], kinds) for key, value in data.items() if key in known]
        fits += [schema.get("additionalProperties", True) is not False or set(data) <= set(known)]
    if isinstance(data, list):
        fits += [holds(entry, schema["items"], kinds) for entry in data if "items" in schema]
    return all(fits)


def fits_the_schema(text: str) -> bool:
    schema = file_schema()
    return holds(yaml.safe_load(text), schema, schema["$defs"])


@pytest.mark.parametrize("path", shipped().values(), ids=shipped())
def test_shipped_scenarios_fit_the_schema(path: Path) -> None:
    assert fits_the_schema(path.read_text())


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("count: 2\nscript: [rtl, land: , {takeoff: 5, at_s: 3}]\nchecks: [no_crash, mode_is: RTL]", True),
        ("vehicles: [{type: plane, mission: [land, takeoff: 5, takeoff: {height_m: 5}]}]", True),
        ("count: 1\nfaults: ['gps_loss:at=3', {fault: gps_loss, at_s: 3}]", True),
        ("seed: 3", False),
        ("count: 1\nchekcs: []", False),
        ("count: 1\nchecks: [min_separation_m]", False),
        ("count: 1\nchecks: [no_crsh]", False),
        ("count: 1\nchecks: [battery_above: 2]", False),
        ("count: 1\nscript: [{rtl: , land: }]", False),
        ("count: 1\nscript: [takeoff]", False),
        ("vehicles: [{mission: [waypoint: {east_m: 3}]}]", False),
    ],
)
def test_schema_and_reader_accept_the_same_short_forms(text: str, fits: bool) -> None:
    assert fits_the_schema(HOME + text) is fits


def test_the_schema_has_every_check_step_and_item() -> None:
    kinds = file_schema()["$defs"]
    assert set(kinds["CheckSpec"]["anyOf"][-1]["properties"]) == set(CHECKS)
    for model in (ScriptStep, Leg):
        assert set(model.choices()) <= set(kinds[model.__name__]["anyOf"][-1]["properties"])


@pytest.mark.interop
def test_the_schema_is_a_command() -> None:
    command = [sys.executable, "-m", "sim_vehicle", "schema"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert json.loads(done.stdout) == file_schema()


# -- random files ---------------------------------------------------------------------------------------

KEYS = st.sampled_from(
    ["home", "count", "vehicles", "script", "checks", "faults", "wind", "area", "hostiles", "lat_deg",
     "lon_deg", "alt_amsl_m", "sysid", "link", "mission", "takeoff", "waypoint", "east_m", "north_m",
     "height_m", "mode", "param", "at_s", "fence", "keep_in", "params", "type", "name", "no_crash", "fault"]
)  # fmt: skip
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-300, 300) | st.floats() | KEYS | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=5),
    max_leaves=20,
)


@settings(max_examples=examples(200))
@given(st.dictionaries(KEYS, VALUES, max_size=6))
def test_a_random_file_is_a_scenario_or_has_errors_with_lines(data: dict[str, Any]) -> None:
    text = yaml.safe_dump({"home": {"lat_deg": 46.0, "lon_deg": 14.5}, **data})
    text_of_error = ""
    try:
        assert parse_scenario(text, "any.yaml").vehicles
    except ScenarioError as error:
        text_of_error = str(error)
    assert all(re.match(r"any\.yaml:\d+: ", line) for line in text_of_error.splitlines()), text_of_error
