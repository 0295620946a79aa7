"""The command line: URLs, homes, personalities, wind, parameters, ports and system ids."""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from sim_vehicle.fleet import Fleet
from sim_vehicle.links.url import Url, UrlError, parse_url
from sim_vehicle.scenarios import Wind
from sim_vehicle.serving.options import (
    FleetOptions,
    OptionError,
    make_scenario,
    parse_home,
    parse_personality,
    parse_urls,
    parse_wind,
    read_param_file,
)

PROPERTY = settings(max_examples=examples(60))


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpout:127.0.0.1:14550", Url("udpout", "127.0.0.1", 14550)),
        ("udpin://:14550", Url("udpin", "0.0.0.0", 14550)),
        ("tcp://drone.local:5760", Url("tcpout", "drone.local", 5760)),
        ("tcpin:[::1]:5760/", Url("tcpin", "::1", 5760)),
        ("10.0.0.7:14551", Url("udpout", "10.0.0.7", 14551)),
        ("serial:/dev/ttyUSB0:57600", Url("serial", "/dev/ttyUSB0", 57600)),
        ("serial:///dev/ttyACM0:115200", Url("serial", "/dev/ttyACM0", 115200)),
        ("serial:COM3:57600", Url("serial", "COM3", 57600)),
    ],
)
def test_a_url_in_the_notations_of_other_tools(text: str, url: Url) -> None:
    assert parse_url(text) == url


@pytest.mark.parametrize(
    ("parse", "option", "texts"),
    [
        (parse_url, "URL", ["", "udp", ":14550", "udpout:x", "udpout:x:0", "udpout:x:65536", "ftp:x:1",
                              "http://x:1", "a:b:c:1", "serial:/dev/x"]),
        (parse_home, "--home", ["46,14", "91,0,0", "90,0,0", "-89.5,0,0", "0,181,0", "0,0,nan", "0,0,0,400",
                                "a,b,c", "1,2,3,4,5", ""]),
        (parse_wind, "--wind", ["5", "-1,0", "61,0", "5,361", "5,0,31", "inf,0", "x,y"]),
        (partial(parse_personality, count=1), "--personality", ["px5", "px4:2", ""]),
    ],
)  # fmt: skip
def test_a_bad_text_is_refused_with_its_option(
    parse: Callable[[str], object], option: str, texts: list[str]
) -> None:
    for text in texts:
        with pytest.raises((UrlError, OptionError), match=option):
            parse(text)


@PROPERTY
@given(st.text(max_size=30))
def test_any_text_is_a_url_or_an_error_with_that_text(text: str) -> None:
    try:
        url = parse_url(text)
    except UrlError as error:
        url, message = None, str(error)
    if url is None:
        assert repr(text) in message
    else:
        assert url.port > 0
        assert parse_url(str(url).replace(" ", ":", 1)) == url


def test_a_duplicate_url_is_an_error() -> None:
    with pytest.raises(OptionError, match=r"udpout 127\.0\.0\.1:1"):
        parse_urls(["udpout:127.0.0.1:1", "127.0.0.1:1"])


@pytest.mark.parametrize(
    ("text", "count", "names"),
    [
        ("px4", None, ["px4"]),
        ("px4", 2, ["px4", "px4"]),
        ("mixed", 3, ["ardupilot", "px4", "ardupilot"]),
        ("mixed", None, ["ardupilot", "px4"]),
        ("ArduPilot", None, ["ardupilot"]),
        ("Mixed", 1, ["ardupilot"]),
    ],
)
def test_the_personality_of_each_vehicle(text: str, count: int | None, names: list[str]) -> None:
    assert parse_personality(text, count) == names


def test_a_home_may_have_a_heading() -> None:
    assert parse_home("46,14.5,300").heading_deg == 0
    home = parse_home("-35.36,149.16,584,353")
    assert (home.lat_deg, home.lon_deg, home.alt_amsl_m, home.heading_deg) == (-35.36, 149.16, 584, 353)


def test_a_wind_is_parsed() -> None:
    assert parse_wind("5,270") == Wind(speed_m_s=5, from_deg=270)
    assert parse_wind("5,270,2") == Wind(speed_m_s=5, from_deg=270, gust_m_s=2)


@PROPERTY
@given(count=st.integers(1, 600), per_port=st.none() | st.integers(1, 250), first=st.integers(1, 250))
def test_system_ids_are_unique_on_a_port_and_in_the_fleet_if_possible(
    count: int, per_port: int | None, first: int
) -> None:
    try:
        scenario, _ = make_scenario(FleetOptions(count=count, per_port=per_port, sysid=first))
    except OptionError as error:
        scenario, message = None, str(error)
    if scenario is None:
        assert f"at most {251 - first} " in message
        assert count > 251 - first
        return
    places = [(v.link, v.sysid) for v in scenario.vehicles]
    assert len(set(places)) == count
    assert {sysid for _, sysid in places} <= set(range(first, 251))
    if first + count <= 251:
        assert [sysid for _, sysid in places] == list(range(first, first + count))
    fullest = max(sum(link == other for other, _ in places) for link, _ in places)
    assert fullest <= (per_port or 250)


def test_surplus_system_ids_use_more_ports_only_on_request() -> None:
    with pytest.raises(OptionError, match=r"--sysid 250: .* 1 of 10 .* --per-port 1$"):
        make_scenario(FleetOptions(count=10, sysid=250))
    scenario, _ = make_scenario(FleetOptions(count=10, sysid=250, per_port=1))
    assert [(v.link, v.sysid) for v in scenario.vehicles] == [(link, 250) for link in range(10)]
    scenario, _ = make_scenario(FleetOptions(count=251))
    assert (scenario.vehicles[-1].link, scenario.vehicles[-1].sysid) == (1, 1)


def test_parameters_are_set_on_vehicles_that_have_them() -> None:
    scenario, notes = make_scenario(
        FleetOptions(personality="mixed", params=["WPNAV_SPEED=800", "MPC_XY_CRUISE = 7.5"])
    )
    ardupilot, px4 = scenario.vehicles
    assert ardupilot.params == {"WPNAV_SPEED": 800}
    assert px4.params == {"MPC_XY_CRUISE": 7.5}
    assert notes == []


def test_an_unknown_parameter_is_an_error() -> None:
    with pytest.raises(OptionError, match=r"--param WPNAV_SPEDE: .*WPNAV_SPEED\b.*\[unknown-parameter\]"):
        make_scenario(FleetOptions(params=["WPNAV_SPEDE=800"]))


def test_a_parameter_file_in_the_formats_of_other_tools(tmp_path: Path) -> None:
    path = tmp_path / "some.parm"
    path.write_text("# comment\nWPNAV_SPEED 700\n\nRTL_ALT,2500 # cm\n1\t1\tBATT_CAPACITY\t5000\t9\n")
    assert read_param_file(path) == {"WPNAV_SPEED": 700, "RTL_ALT": 2500, "BATT_CAPACITY": 5000}
    path.write_text("WPNAV_SPEED 700\nINS_GYR_CAL 17\n")
    scenario, notes = make_scenario(FleetOptions(param_files=[path], params=["WPNAV_SPEED=800"]))
    assert scenario.vehicles[0].params == {"WPNAV_SPEED": 800}
    assert len(notes) == 1
    assert f"{path}: 1 of 2 parameters" in notes[0]


def test_a_bad_line_of_a_parameter_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "some.parm"
    path.write_text("A 1\nB two\nC\n")
    with pytest.raises(OptionError) as caught:
        read_param_file(path)
    assert [line.partition(" is not ")[0] for line in str(caught.value).splitlines()] == [
        f"--param-file {path}:2: 'B two'",
        f"--param-file {path}:3: 'C'",
    ]


def test_options_override_a_scenario(tmp_path: Path) -> None:
    path = tmp_path / "two.yaml"
    path.write_text("home: {lat_deg: 46, lon_deg: 14.5}\ncount: 2\nseed: 3\nfaults: ['gps_loss:at=5']\n")
    options = FleetOptions(
        scenario=path, wind="4,90", faults=["packet_loss:rate=0.5"], params=["WPNAV_SPEED=900"]
    )
    scenario, _ = make_scenario(options)
    assert scenario.seed == 3
    assert scenario.wind.speed_m_s == 4
    assert [fault.fault for fault in scenario.faults] == ["gps_loss", "packet_loss"]
    assert [vehicle.params for vehicle in scenario.vehicles] == [{"WPNAV_SPEED": 900}] * 2
    with pytest.raises(OptionError, match=r"--count, --home: .* --scenario"):
        make_scenario(FleetOptions(scenario=path, count=3, home="1,2,3"))


def test_a_fault_on_an_unknown_system_id_is_an_error() -> None:
    faults = ["gps_loss:sysid=9", "gps_loss:sysid=8"]
    with pytest.raises(OptionError, match=r"^faults\.0: .* \[9\].*\nfaults\.1: .* \[8\]"):
        make_scenario(FleetOptions(count=2, faults=faults))


def test_vehicles_face_the_heading_of_home() -> None:
    scenario, _ = make_scenario(FleetOptions(home="46,14.5,300,270", count=2))
    fleet = Fleet(scenario, ready_s=0.0)
    assert fleet.world.dynamics.attitude[2] == pytest.approx([-0.5 * math.pi] * 2)
