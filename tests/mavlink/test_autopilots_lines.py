"""Coverage of the observations on the two autopilots: each line has a test on each autopilot it names.

The simulator's tests (`tests/sim`) show that its vehicles behave as observed. The tests counted here show
that the ground station flies such vehicles. `autopilot_lines` has the lines, and the mark by which a test
names the line it pins.
"""

from __future__ import annotations

import functools
from pathlib import Path

from autopilot_lines import BOTH, LINES, marked

TESTS = Path(__file__).parents[1]

NOT_APPLICABLE: dict[str, str] = {
    "2 speed": "the speed of a transfer depends on link and vehicle; `benchmarks/links.py` measures it",
}
"""Lines that do not concern this ground station, with the reason."""


def lines_of_autopilots() -> dict[str, frozenset[str]]:
    """Return the lines of AUTOPILOTS.md; MAVSDK.md has its own."""
    return {line: of for line, of in LINES.items() if not line.startswith("MAVSDK")}


@functools.cache
def all_marked() -> list[tuple[str, str, str]]:
    """Return the marks of all tests but the simulator's own."""
    files = (path for path in sorted(TESTS.rglob("test_*.py")) if TESTS / "sim" not in path.parents)
    return [found for path in files for found in marked(path)]


def test_every_line_is_tested_on_each_of_its_autopilots() -> None:
    tested = {(line, of) for line, of, _ in all_marked()}
    wanted = {
        (line, of)
        for line, autopilots in lines_of_autopilots().items()
        if line not in NOT_APPLICABLE
        for of in autopilots
    }
    assert sorted(wanted - tested) == []


def test_no_test_names_a_missing_line() -> None:
    unknown = [
        f"{test} names {line!r} of {of}"
        for line, of, test in all_marked()
        if line not in lines_of_autopilots()
        or of not in BOTH
        or (line not in NOT_APPLICABLE and of not in lines_of_autopilots()[line])
    ]
    assert unknown == []


def test_a_line_that_does_not_apply_has_a_reason_and_no_test() -> None:
    assert all(line in lines_of_autopilots() and why for line, why in NOT_APPLICABLE.items())
    assert {line for line, _, _ in all_marked()} & set(NOT_APPLICABLE) == set()
