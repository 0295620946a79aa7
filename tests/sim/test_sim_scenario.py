"""The scenario file and the URL: what is taken, and what is said about the rest."""

import json
from pathlib import Path
from typing import Any

import pytest

from sim_vehicle.scenario import ScenarioError, default_scenario, load_scenario
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


def written(tmp_path: Path, content: Any) -> Path:
    path = tmp_path / "scenario.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_a_scenario_is_read(tmp_path: Path) -> None:
    scenario = load_scenario(written(tmp_path, GOOD))
    assert scenario.seed == 7
    assert scenario.hostiles == [(3, 4)]
    assert load_scenario(written(tmp_path, {"vehicles": [VEHICLE]})).area is None


@pytest.mark.parametrize(
    ("content", "words"),
    [
        pytest.param("{", "scenario.json:1:2: not valid JSON", id="broken JSON"),
        pytest.param({**GOOD, "hostile": []}, "hostile: Extra inputs", id="an unknown key"),
        pytest.param({**GOOD, "vehicles": []}, "vehicles: List should have at least 1", id="no vehicle"),
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
            "no such parameters: WPNAV_SPED",
            id="an unknown parameter",
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


def test_a_counted_fleet_stands_side_by_side() -> None:
    scenario = default_scenario(3, home=(46.0, 14.5, 10.0), first_sysid=7)
    assert [v.sysid for v in scenario.vehicles] == [7, 8, 9]
    step_m = (scenario.vehicles[1].lon_deg - scenario.vehicles[0].lon_deg) * 77_450
    assert step_m == pytest.approx(5, abs=0.1)
    with pytest.raises(ScenarioError, match="sysid"):
        default_scenario(10, home=(46.0, 14.5, 10.0), first_sysid=245)


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
    "text", ["", "udp", "http://x:1", "udpout:127.0.0.1", "udpin:0.0.0.0:70000", "serial:/dev/x:9"]
)
def test_bad_urls_are_refused(text: str) -> None:
    with pytest.raises(UrlError, match="--url"):
        parse_url(text)
