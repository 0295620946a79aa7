"""The scenario file and the URL: what is taken, and what is said about the rest."""

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.faults.spec import parse_fault
from sim_vehicle.physics.geodesy import LocalFrame
from sim_vehicle.scenario import Scenario, ScenarioError, default_scenario, load_scenario
from sim_vehicle.scenario.file import parse_scenario
from sim_vehicle.scenario.plan import PlanWriter
from sim_vehicle.url import Url, UrlError, parse_url

VEHICLE = {"sysid": 1, "lat_deg": 46.0, "lon_deg": 14.5, "alt_amsl_m": 10.0}
AREA = {"origin_lat_deg": 46.0, "origin_lon_deg": 14.5, "rows": 20, "cols": 20, "cell_size_m": 50.0}
GOOD: dict[str, Any] = {
    "seed": 7,
    "vehicles": [VEHICLE],
    "area": AREA,
    "firing_strength": [0.6, 0.3, 0.1],
    "hostiles": [[3, 4]],
}
HOME = "home: {lat_deg: 46.0, lon_deg: 14.5, alt_amsl_m: 300}\n"


def written(tmp_path: Path, content: Any) -> Path:
    path = tmp_path / "scenario.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def from_yaml(tmp_path: Path, text: str) -> Scenario:
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return load_scenario(path)


def refused(tmp_path: Path, text: str) -> list[str]:
    """The lines of the error, without the folder."""
    with pytest.raises(ScenarioError) as caught:
        from_yaml(tmp_path, text)
    return str(caught.value).replace(f"{tmp_path}/", "").splitlines()


def place_m(scenario: Scenario, index: int) -> tuple[float, float]:
    """East and north of a vehicle from 46 N, 14.5 E."""
    spec = scenario.vehicles[index]
    return LocalFrame(46.0, 14.5).point_to_local(spec.lat_deg, spec.lon_deg)


def test_a_scenario_is_read(tmp_path: Path) -> None:
    scenario = load_scenario(written(tmp_path, GOOD))
    assert scenario.seed == 7
    assert scenario.hostiles == ((3, 4),)
    assert load_scenario(written(tmp_path, {"vehicles": [VEHICLE]})).area is None


def test_json_with_tabs_has_its_lines_too(tmp_path: Path) -> None:
    text = json.dumps(GOOD | {"seed": -1}, indent="\t")
    with pytest.raises(ScenarioError, match=r"scenario\.json:2: seed: "):
        load_scenario(written(tmp_path, text))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        pytest.param("{", "scenario.json:1: this is not JSON", id="broken JSON"),
        pytest.param({**GOOD, "hostile": []}, "hostile: no such key; did you mean `hostiles`", id="unknown"),
        pytest.param({**GOOD, "vehicles": []}, "vehicles: list should have at least 1", id="no vehicle"),
        pytest.param(
            {**GOOD, "vehicles": [VEHICLE, VEHICLE]}, "occur more than once: [1]", id="a sysid twice"
        ),
        pytest.param({**GOOD, "vehicles": [VEHICLE | {"sysid": 0}]}, "vehicles.0.sysid", id="sysid 0"),
        pytest.param({**GOOD, "firing_strength": [0.3, 0.3, 0.1]}, "must decrease", id="strengths level"),
        pytest.param({**GOOD, "hostiles": [[20, 0]]}, "outside the area of 20 rows", id="a hostile outside"),
        pytest.param({**GOOD, "hostiles": [[1, 1], [1, 1]]}, "named twice", id="a hostile twice"),
        pytest.param({**GOOD, "area": None}, "hostiles need `area`", id="hostiles without an area"),
        pytest.param(
            {**GOOD, "vehicles": [VEHICLE | {"params": {"WPNAV_SPED": 1}}]},
            "no such parameters of ardupilot copter: WPNAV_SPED",
            id="an unknown parameter",
        ),
        pytest.param(
            {**GOOD, "vehicles": [VEHICLE | {"personality": "px4", "params": {"WPNAV_SPEED": 1}}]},
            "no such parameters of px4 copter: WPNAV_SPEED",
            id="another autopilot's parameter",
        ),
    ],
)
def test_a_bad_scenario_is_refused_with_the_reason(tmp_path: Path, content: Any, words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(written(tmp_path, content))
    assert words in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"nothing\.json: cannot be read"):
        load_scenario(tmp_path / "nothing.json")


# -- YAML: short forms -----------------------------------------------------------------------------------


def test_a_count_alone_is_a_scenario(tmp_path: Path) -> None:
    scenario = from_yaml(tmp_path, HOME + "count: 3")
    assert [v.sysid for v in scenario.vehicles] == [1, 2, 3]
    assert [round(place_m(scenario, i)[0], 3) for i in range(3)] == [0.0, 5.0, 10.0]
    assert {v.alt_amsl_m for v in scenario.vehicles} == {300.0}
    assert scenario.name == "scenario"


def test_vehicles_stand_in_metres_from_home_and_are_numbered(tmp_path: Path) -> None:
    scenario = from_yaml(
        tmp_path,
        HOME
        + """
vehicles:
  - {count: 2, spacing_m: 30, north_m: -40, personality: px4}
  - {sysid: 9, east_m: 7}
  - {type: plane}
  - {lat_deg: 46.5, lon_deg: 14.5}
""",
    )
    assert [v.sysid for v in scenario.vehicles] == [1, 2, 9, 10, 11]
    assert [v.personality for v in scenario.vehicles[:3]] == ["px4", "px4", "ardupilot"]
    assert scenario.vehicles[3].kind == "plane"
    assert place_m(scenario, 1) == pytest.approx((30, -40), abs=1e-3)
    assert place_m(scenario, 2) == pytest.approx((7, 0), abs=1e-3)
    assert scenario.vehicles[4].lat_deg == pytest.approx(46.5)


def test_more_than_250_go_on_to_the_next_link(tmp_path: Path) -> None:
    for scenario in (
        from_yaml(tmp_path, HOME + "count: 600"),
        default_scenario(600, home=(46.0, 14.5, 10.0)),
    ):
        assert Counter(v.link for v in scenario.vehicles) == {0: 250, 1: 250, 2: 100}
        assert len({(v.link, v.sysid) for v in scenario.vehicles}) == 600
        assert max(v.sysid for v in scenario.vehicles) == 250


def test_one_anchor_serves_many_missions_each_around_its_own_start(tmp_path: Path) -> None:
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
        assert (waypoint.z, waypoint.param1) == (25, 2)
        assert jump.param1 == first + 2  # the waypoint
        assert land.command == mavlink.MAV_CMD_NAV_LAND
        assert (land.x, land.y) == (waypoint.x, waypoint.y)
        assert spec.goal_m() == (30, 40)


def test_faults_are_written_as_on_the_command_line_or_by_their_fields(tmp_path: Path) -> None:
    scenario = from_yaml(
        tmp_path,
        HOME
        + """
count: 2
faults:
  - packet_loss:rate=0.2,at=30,for=10,sysid=2
  - {fault: packet_loss, at_s: 30, for_s: 10, vehicles: [2], params: {rate: 0.2}}
""",
    )
    assert scenario.faults[0] == parse_fault("packet_loss:rate=0.2,at=30,for=10,sysid=2")
    assert scenario.faults[1].parameters() == scenario.faults[0].parameters()
    assert scenario.faults[1].vehicles == [2]


def test_a_loaded_scenario_survives_being_written_out(tmp_path: Path) -> None:
    scenario = from_yaml(
        tmp_path,
        HOME
        + """
vehicles: [{mission: [{takeoff: 5}, rtl], fence: [{keep_in_circle: {east_m: 0, north_m: 0, radius_m: 50}}]}]
script: [fly_mission, {at_s: 3, mode: RTL}, {param: {RTL_ALT: 3000}, expect: any}]
checks: [no_crash, min_separation_m: 5, mode_is: {mode: RTL, by_s: 5}]
faults: ["gps_loss:at=3"]
""",
    )
    assert Scenario.model_validate(scenario.model_dump()) == scenario
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario


# -- YAML: errors ----------------------------------------------------------------------------------------


def test_every_mistake_is_found_at_once_with_its_line_and_cure(tmp_path: Path) -> None:
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
    assert "did you mean `waypoint`?" in text
    assert "found land and rtl" in text
    assert "'ardupilot' or 'px4'" in text
    assert "did you mean `checks`?" in text
    assert "no such check: 'no_crsh'; known are no_crash" in text
    assert "as in `min_separation_m: 5`" in text
    assert "landed does not take 'by'; it takes vehicles" in text
    assert "meant: packet_loss?" in text


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "the file is empty"),
        ("just words", 1, "a scenario is a mapping"),
        ("count: 1\ncount: 2", 2, "given twice, first on line 1"),
        ("a: [", 1, "not YAML"),
        (HOME + "count: 0", 2, "greater than or equal to 1"),
        ("count: 2", 1, "needs lat_deg and lon_deg, or the scenario a `home`"),
        ("home: {lat_deg: 91, lon_deg: 0}\ncount: 1", 1, "less than or equal to 90, found 91"),
        (HOME + "count: 1\nvehicles: [{}]", 2, "keep one of them"),
        (HOME + "vehicles:\n  - {lat_deg: 46, lon_deg: 14, east_m: 3}", 3, "metres are from `home`"),
        (HOME + "count: 1\nscript:\n  - {mode: HOVER}", 4, "has no mode 'HOVER'; it has STABILIZE"),
        (HOME + "count: 1\nscript:\n  - {param: {FOO: 1}}", 4, "has no parameters FOO"),
        (HOME + "count: 1\nscript: [fly_mission]", 3, "vehicle 1 has no `mission`"),
        (HOME + "count: 1\nscript: [{mode: RTL, vehicles: [2]}]", 3, "no vehicle has system id [2]"),
        (HOME + "count: 1\nchecks: [reached_goal]", 3, "needs `goal` or a mission with a place"),
        (HOME + "count: 1\nchecks: [no_fence_breach]", 3, "needs `fence` of vehicles [1]"),
        (HOME + "count: 1\nchecks: [stays_in_area]", 3, "needs the scenario's `area`"),
        (HOME + "count: 1\nchecks: [{no_crash: 5}]", 3, "does not take 'value'"),
        (HOME + "count: 1\nchecks: [{mode_is: 5}]", 3, "takes words (mode), found 5"),
        (HOME + "count: 1\nchecks: [{no_crash: {by_s: 5}}]", 3, "is for what happens eventually"),
        (HOME + "count: 1\nwind: {speed_m_s: '7'}", 3, "valid number, found '7'"),
    ],
)
def test_a_mistake_names_its_line_and_what_is_wanted(
    tmp_path: Path, text: str, line: int, words: str
) -> None:
    lines = refused(tmp_path, text)
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"scenario.yaml:{line}: ")
    assert words in lines[0]


def test_a_counted_fleet_stands_side_by_side() -> None:
    scenario = default_scenario(3, home=(46.0, 14.5, 10.0), first_sysid=7)
    assert [v.sysid for v in scenario.vehicles] == [7, 8, 9]
    assert place_m(scenario, 1)[0] == pytest.approx(5, abs=0.01)
    with pytest.raises(ScenarioError, match="sysid"):
        default_scenario(10, home=(46.0, 14.5, 10.0), first_sysid=245)
    assert [v.link for v in default_scenario(5, home=(46.0, 14.5, 10.0), per_link=2).vehicles] == [
        0,
        0,
        1,
        1,
        2,
    ]
    mixed = default_scenario(4, home=(46.0, 14.5, 10.0), personality="mixed").vehicles
    assert [v.personality for v in mixed] == ["ardupilot", "px4", "ardupilot", "px4"]


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpout:127.0.0.1:14550", Url("udpout", "127.0.0.1", 14550)),
        ("udpout://127.0.0.1:14550", Url("udpout", "127.0.0.1", 14550)),
        ("udpin::14550", Url("udpin", "0.0.0.0", 14550)),
        ("tcpin://0.0.0.0:5760", Url("tcpin", "0.0.0.0", 5760)),
        ("tcpout:localhost:5760", Url("tcpout", "localhost", 5760)),
    ],
)
def test_urls_are_understood(text: str, url: Url) -> None:
    assert parse_url(text) == url


@pytest.mark.parametrize(
    "text", ["", "udp", "http://x:1", "udpout:127.0.0.1", "udpin:0.0.0.0:70000", "serial:/dev/x"]
)
def test_bad_urls_are_refused(text: str) -> None:
    with pytest.raises(UrlError, match="--url"):
        parse_url(text)


# -- anything at all ---------------------------------------------------------------------------------------

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


@settings(max_examples=200, derandomize=True, deadline=None)
@given(st.dictionaries(KEYS, VALUES, max_size=6))
def test_whatever_a_file_says_it_is_a_scenario_or_an_error_with_lines(data: dict[str, Any]) -> None:
    text = yaml.safe_dump({"home": {"lat_deg": 46.0, "lon_deg": 14.5}, **data})
    said = ""
    try:
        assert parse_scenario(text, "any.yaml").vehicles
    except ScenarioError as error:
        said = str(error)
    assert all(re.match(r"any\.yaml:\d+: ", line) for line in said.splitlines()), said
