"""Every line of the observations of both autopilots has a test, for each autopilot it mentions.

`autopilot_lines` has the lines and the mark by which a test names its line.
"""

from functools import cache
from pathlib import Path

from autopilot_lines import LINES, marked

# Observations without a possible test: the line, the part of it, and the reason.
NOT_PINNED = (
    ("1.16", "1376 params", "the simulator has only parameters with an effect"),
    ("1.19", "410 (EVENT) among the unknown ones", "no events are sent; 380, 411 and 436 are"),
    (
        "2 speed",
        "600 items in 3.4 s, 8 items in 10 ms",
        "times of a link and a processor; here both depend on the host",
    ),
)


@cache
def all_marked() -> list[tuple[str, str, str]]:
    return [found for path in sorted(Path(__file__).parent.glob("test_*.py")) for found in marked(path)]


def test_every_line_has_a_test_for_each_of_its_autopilots() -> None:
    pinned = {(line, of) for line, of, _ in all_marked()}
    wanted = {(line, of) for line, autopilots in LINES.items() for of in autopilots}
    assert sorted(wanted - pinned) == []


def test_no_test_names_a_missing_line() -> None:
    strangers = [
        f"{test} pins {line!r} of {of}"
        for line, of, test in all_marked()
        if of not in LINES.get(line, frozenset())
    ]
    assert strangers == []


def test_a_line_without_a_test_has_a_reason() -> None:
    assert {line for line, autopilots in LINES.items() if not autopilots} <= {
        line for line, _, _ in NOT_PINNED
    }
    assert all(line in LINES and what and why for line, what, why in NOT_PINNED)
