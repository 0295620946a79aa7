"""Tables on terminals of any width and on a pipe: whole columns or none."""

import io
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from rich.console import Console
from rich.text import Text

from sim_vehicle.fleet import Fleet
from sim_vehicle.links.url import parse_url
from sim_vehicle.scenarios.checking import CheckFailure
from sim_vehicle.scenarios.report import fold, print_verdict, write_verdict
from sim_vehicle.scenarios.runner import CheckVerdict, FinalVehicleState, Verdict
from sim_vehicle.serving.columns import GAP, Column, fitting, one_line, table
from sim_vehicle.serving.display import Display
from sim_vehicle.serving.options import FleetOptions, make_scenario
from sim_vehicle.serving.pace import ManualPace
from sim_vehicle.serving.server import Server

PROPERTY = settings(max_examples=examples(150))
WORDS = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=30)


def column(
    heading: str, *cells: str, priority: int, min_cut_width: int | None = None, right: bool = False
) -> Column:
    return Column(heading, [Text(cell) for cell in cells], priority, min_cut_width=min_cut_width, right=right)


@st.composite
def tables(draw: st.DrawFn) -> list[Column]:
    """Draw a table: an id of up to 8 characters, further columns, and perhaps one that may be cut."""
    rows = draw(st.integers(0, 4))
    priorities = draw(st.permutations(range(draw(st.integers(0, 7)))))
    columns = [column("id", *(f"{i}:{10 ** draw(st.integers(0, 4))}" for i in range(rows)), priority=99)]
    columns += [
        column(
            f"{i}{draw(WORDS)}",
            *(draw(WORDS) for _ in range(rows)),
            priority=priority,
            right=draw(st.booleans()),
        )
        for i, priority in enumerate(priorities)
    ]
    if draw(st.booleans()):
        last = (" ".join(draw(st.lists(WORDS, max_size=5))) for _ in range(rows))
        columns.append(
            column("faults", *last, priority=draw(st.integers(0, 98)), min_cut_width=draw(st.integers(6, 20)))
        )
    return columns


def plain(lines: Sequence[Text]) -> list[str]:
    return [line.plain for line in lines]


@PROPERTY
@given(tables(), st.integers(20, 200))
def test_every_column_is_whole_or_absent(columns: list[Column], width: int) -> None:
    lines = plain(table(columns, width))
    kept = fitting(columns, width)
    assert kept[0].heading == "id"
    assert all(len(line) <= width for line in lines)
    for row, line in enumerate(lines[1:]):
        position = 0
        for shown in kept:
            cell = shown.cells[row].plain
            if shown.min_cut_width is None:
                field = line[position : position + shown.width]
                assert field.strip() == cell
                position += shown.width + GAP
            else:
                room = width - position
                assert room >= min(shown.width, shown.min_cut_width)
                rest = line[position:]
                assert rest == cell.rstrip() or (len(cell) > room and rest == f"{cell[: room - 1]}…")


@PROPERTY
@given(tables())
def test_without_a_width_no_cell_is_cut_or_padded(columns: list[Column]) -> None:
    for row, line in enumerate(plain(table(columns, None))[1:]):
        assert line == line.rstrip()
        assert all(shown.cells[row].plain.strip() in line for shown in columns)


def test_a_long_line_is_shortened_from_its_end() -> None:
    words = ["12 vehicles", "3 armed", "1 flying"]
    shown = [one_line(words, width, "").plain for width in (40, 25, 12, 6)]
    assert shown == ["12 vehicles  3 armed  1 flying", "12 vehicles  3 armed", "12 vehicles", "12 ve…"]


# -- the live table ---------------------------------------------------------------------------------------


def live(options: FleetOptions, warning: str = "") -> Display:
    fleet = Fleet(make_scenario(options)[0], ready_s=0)
    fleet.step(0.0)
    server = Server(fleet, [parse_url("udpout:127.0.0.1:14550")], ManualPace(), warn=lambda text: None)
    return Display(server, lambda: warning)


def shown(display: Display, width: int, height: int = 24, wall_s: float = 0.0) -> list[str]:
    console = Console(file=io.StringIO(), width=width, height=height, color_system=None)
    console.print(display.render(wall_s, width, height))
    return [text.rstrip() for text in console.file.getvalue().splitlines()]


FAULTS = ["motor_loss", "gps_loss"]


def test_columns_disappear_in_their_order() -> None:
    display = live(FleetOptions(count=2, faults=FAULTS[:1]))
    gone: list[str] = []
    names = ["latitude", "hit", "msg/s", "armed", "type", "m/s", "faults", "height", "mode", "batt"]
    for width in range(160, 11, -1):
        (heading,) = [line for line in shown(display, width) if line.split()[:1] == ["id"]]
        words = heading.replace("latitude, longitude", "latitude").replace("height m", "height").split()
        gone += [name for name in names if name not in words and name not in gone]
    assert gone == names[:-1]


def test_columns_keep_their_width_on_every_page_of_the_fleet() -> None:
    display = live(FleetOptions(count=40, faults=["packet_loss:sysid=1"]))
    pages = [shown(display, 80, height=16, wall_s=5.0 * page) for page in range(4)]
    assert len({line for lines in pages for line in lines if line.split()[0] == "id"}) == 1
    assert [f"page {page + 1}/4  40 vehicles" in lines[-1] for page, lines in enumerate(pages)] == [True] * 4
    first_words = (line.split()[0] for lines in pages for line in lines)
    assert {int(word) for word in first_words if word.isdecimal()} == set(range(1, 41))


def test_a_warning_is_shown_below_the_table() -> None:
    lines = shown(live(FleetOptions(count=60), "cannot keep up with 10x real time"), 30, height=12)
    assert lines[-1] == "cannot keep up with 10x real …"
    assert len(lines) == 12


# -- the tables of a run ----------------------------------------------------------------------------------


LONG = "PreArm: Compass not calibrated; and more words until the line is far too long for any terminal"


def verdict() -> Verdict:
    ends = [
        FinalVehicleState(
            sysid=n, link=n - 1, personality="ardupilot", kind="copter", mode="STABILIZE", armed=True,
            height_m=1234.5, from_start_m=12345.6, flown_m=123456.7, battery_remaining=1.0, strikes=n,
            messages=5, last_text=LONG,
        )
        for n in (1, 250)
    ]  # fmt: skip
    failures = [CheckFailure("never_says 'x'", n, 0, 75.10000000000001, LONG) for n in range(1, 6)]
    checks = [
        CheckVerdict("no_crash", passed=True, failures=[]),
        CheckVerdict("never_says 'x'", False, failures),
    ]
    return Verdict("two", 7, 75.10000000000001, checks, [], ends)


def report(width: int, *, terminal: bool) -> list[str]:
    console = Console(file=io.StringIO(), width=width, force_terminal=terminal, color_system=None)
    print_verdict(console, verdict())
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize("width", [20, 40, 60, 80, 100, 110, 160, 240])
def test_the_tables_of_a_run_fit_a_terminal(width: int) -> None:
    lines = report(width, terminal=True)
    assert all(len(line) <= width for line in lines)
    assert "passed  no_crash" in lines
    assert "FAILED  never_says" in "\n".join(lines)
    (heading,) = [line for line in lines if line.startswith("id")]
    ends = [line.split() for line in lines[lines.index(heading) + 1 :]]
    assert [end[0] for end in ends] == ["1", "249:250"]
    assert all("100%" in end for end in ends)
    assert all(("STABILIZE" in end) == ("mode" in heading.split()) for end in ends)
    assert "…" not in heading
    for line in lines:
        assert "…" not in line or line.index("…") >= heading.index("last text")


def test_the_last_text_disappears_first() -> None:
    (heading,) = [line for line in report(84, terminal=True) if line.startswith("id")]
    assert heading.split()[-1] == "hit"


def test_a_pipe_gets_every_word_and_no_padding() -> None:
    lines = report(80, terminal=False)
    assert all(line == line.rstrip() for line in lines)
    assert [line for line in lines if not line] == [""]  # between the two tables
    assert sum(line.endswith(LONG) for line in lines) == 3 + 2  # of five failures three are shown
    assert f"        vehicle 1 at 75.10 s: {LONG}" in lines


def test_times_in_the_verdict_are_rounded(tmp_path: Path) -> None:
    write_verdict(tmp_path, verdict())
    text = (tmp_path / "verdict.json").read_text()
    assert text.count('"t_s": 75.1,') == 5
    assert '"simulated_s": 75.1,' in text


def test_continued_lines_are_indented() -> None:
    assert plain(fold(Text("landed: on the ground, and disarmed"), 20, "    ")) == [
        "landed: on the",
        "    ground, and",
        "    disarmed",
    ]
