"""Each line of the notes on the two autopilots has tests for each autopilot that it names.

The tests of the simulator (`tests/sim`) show that its vehicles behave as observed, all other tests that the
ground station flies such vehicles. A marker names the line that a test covers:
`@pytest.mark.autopilots("1.14", "2 error codes", of="px4")` has numbers of section 1 and rows of section 2 of
AUTOPILOTS.md, and rows of MAVSDK.md. A marker without `of` means ArduPilot.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
ARDUPILOT, PX4 = frozenset({"ardupilot"}), frozenset({"px4"})
BOTH = ARDUPILOT | PX4

LINES: dict[str, frozenset[str]] = {
    "1.1": ARDUPILOT,  # streams are requested, and again after a reboot
    "1.2": ARDUPILOT,  # bytes that are no MAVLink
    "1.3": ARDUPILOT,  # 41 s until the vehicle is ready
    "1.4": ARDUPILOT,  # a mode set in the first 2 s is undone
    "1.5": BOTH,  # numbers of the modes; the acknowledgement, and the delay until a heartbeat shows the mode
    "1.6": ARDUPILOT,  # modes that hold altitude without RC
    "1.7": ARDUPILOT,  # the start of a mission
    "1.8": ARDUPILOT,  # a mission with a take-off
    "1.9": ARDUPILOT,  # an empty mission
    "1.10": ARDUPILOT,  # the current item advances while the vehicle is disarmed
    "1.11": ARDUPILOT,  # home moves
    "1.12": ARDUPILOT,  # after the landing
    "1.13": ARDUPILOT,  # system_status
    "1.14": BOTH,  # disarming in flight
    "1.15": ARDUPILOT,  # components and systems
    "1.16": BOTH,  # parameters
    "1.17": BOTH,  # DO_REPOSITION
    "1.18": ARDUPILOT,  # sockets
    "1.19": PX4,  # messages that pymavlink does not know
    "1.20": ARDUPILOT,  # faults by parameter
    "2 item 0": BOTH,
    "2 count": BOTH,
    "2 requests": BOTH,
    "2 upload is atomic?": BOTH,
    "2 re-upload in AUTO": BOTH,
    "2 shorter mission": BOTH,
    "2 CLEAR_ALL": BOTH,
    "2 abandoned upload": BOTH,
    "2 second GCS / download during upload": BOTH,
    "2 wrong / duplicate item": BOTH,
    "2 error codes": BOTH,
    "2 RTL item": BOTH,
    "2 frame 2 on a WP": ARDUPILOT,  # not tried with PX4
    "2 read-back": BOTH,
    "2 DO_SET_MISSION_CURRENT": BOTH,
    "2 MISSION_SET_CURRENT": BOTH,
    "2 MISSION_WRITE_PARTIAL_LIST": BOTH,
    "2 pause/continue": BOTH,
    "2 fence": BOTH,
    "2 fence use": BOTH,
    "2 speed": frozenset(),
    "2 types 2 / 3 / 255": BOTH,
    "2 PX4 otherwise": BOTH,  # the altitude of a take-off, of both autopilots
    "MAVSDK 3 replace mid-flight": BOTH,
    "MAVSDK 5 takeoff": BOTH,
    "MAVSDK 5 hold": BOTH,
    "MAVSDK 5 RTL / land": BOTH,
    "MAVSDK 5 goto_location": BOTH,
    "MAVSDK 5 set_current_speed": BOTH,
    "MAVSDK 5 start_mission": BOTH,
    "MAVSDK 5 mission_raw item 0": BOTH,
    "MAVSDK 5 clear_mission": BOTH,
    "MAVSDK 5 geofence": BOTH,
    "MAVSDK 5 telemetry": BOTH,
    "MAVSDK 5 params": ARDUPILOT,
    "MAVSDK 5 offboard": BOTH,
    "MAVSDK 5 failure": BOTH,
    "MAVSDK 5 log_files": BOTH,
}

NOT_COVERED = {
    "2 speed": "times of a link and a processor; `benchmarks/links.py` measures them",
}
"""Lines without a test, with the reason.

The simulator's tests also leave out the number of parameters (1.16), because it has only those with an
effect, and message 410 (1.19), because it sends no events.
"""
WHOSE = pytest.mark.parametrize("whose", ["simulator", "ground station"])


def lines_for(whose: str) -> dict[str, frozenset[str]]:
    """Return the lines that the tests have to cover; MAVSDK.md does not concern this ground station."""
    return {line: of for line, of in LINES.items() if whose == "simulator" or not line.startswith("MAVSDK")}


def marked(path: Path) -> Iterator[tuple[str, str, str]]:
    """Yield line, autopilot and test of each marker in a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef):
            continue
        for decorator in node.decorator_list:
            if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.autopilots":
                of = {keyword.arg: ast.literal_eval(keyword.value) for keyword in decorator.keywords}
                for argument in decorator.args:
                    yield ast.literal_eval(argument), of.get("of", "ardupilot"), f"{path.name}::{node.name}"


@functools.cache
def all_marked(whose: str) -> list[tuple[str, str, str]]:
    files = sorted(TESTS.rglob("test_*.py"))
    chosen = [path for path in files if (TESTS / "sim" in path.parents) == (whose == "simulator")]
    return [found for path in chosen for found in marked(path)]


@WHOSE
def test_every_line_is_tested_on_each_of_its_autopilots(whose: str) -> None:
    tested = {(line, of) for line, of, _ in all_marked(whose)}
    wanted = {(line, of) for line, autopilots in lines_for(whose).items() for of in autopilots}
    assert sorted(wanted - tested) == []


@WHOSE
def test_no_test_names_a_missing_line(whose: str) -> None:
    lines = lines_for(whose)
    assert [found for found in all_marked(whose) if found[1] not in lines.get(found[0], ())] == []


def test_only_a_line_without_an_autopilot_has_no_test() -> None:
    assert {line for line, autopilots in LINES.items() if not autopilots} == set(NOT_COVERED)
