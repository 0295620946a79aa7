"""Tables on narrow terminals: whole columns are left out, and nothing is cut."""

from __future__ import annotations

import pytest
from rich.console import Console
from rich.text import Text

from swarmctl.agent.phases import Phase
from swarmctl.report.live_rows import SwarmView, VehicleRow, live_table
from swarmctl.report.tables import Column, FittedTable

COLUMNS = [
    Column("vehicle", "left"), Column("flown\n[m]"), Column("least\nimportant", rank=2),
    Column("less important", rank=1), Column("outcome", "left", wraps_at=8),
]  # fmt: skip


OUTCOME = ("the", "battery", "is", "low;", "it", "returned", "and", "landed")


def shown(width: int, outcome: str = "arrived") -> list[str]:
    table = FittedTable(COLUMNS, elsewhere="summary.json")
    table.add_row("uav1", "1210", "17", "42", Text(outcome))
    table.add_row("uav2", "950", "", "", "landed")
    return printed(table, width)


def printed(content: object, width: int) -> list[str]:
    console = Console(width=width)
    with console.capture() as capture:
        console.print(content)
    return capture.get().splitlines()


def words(lines: list[str]) -> set[str]:
    return set(" ".join(lines).split())


def test_a_wide_table_has_all_columns_and_no_note() -> None:
    page = words(shown(80))
    assert {"vehicle", "flown", "[m]", "least", "important", "less", "outcome", "1210", "17", "42"} <= page
    assert "summary.json" not in page


@pytest.mark.parametrize(("width", "there", "left_out"), [(45, "42", "17"), (30, "1210", "42")])
def test_a_narrow_table_leaves_out_columns_by_rank_and_names_them(
    width: int, there: str, left_out: str
) -> None:
    lines = shown(width)
    rows = [line for line in lines if "uav" in line]
    assert there in words(rows)
    assert left_out not in words(rows)
    assert "summary.json" in words(lines)
    assert "least" in words(lines)
    assert max(map(len, lines)) <= width


@pytest.mark.parametrize("width", range(28, 90))
def test_no_heading_and_no_value_is_cut_at_any_width(width: int) -> None:
    lines = shown(width, " ".join(OUTCOME))
    assert not any("…" in line for line in lines)
    page = words(lines)
    assert {"vehicle", "flown", "[m]", "outcome", "uav1", "1210", "uav2", "950"} <= page
    assert set(OUTCOME) <= page


ROW = VehicleRow("uav12", Phase.FLYING, "AUTO.MISSION", 100, 0.5, 100, 1200, 24, 12, 3, "lost 123 s", "")


@pytest.mark.parametrize("width", [80, 92, 100, 140])
def test_the_live_table_fits_without_cut_headings(width: int) -> None:
    lines = printed(live_table(SwarmView("first-flight", 60.0, 10.0, [ROW]), width, 24), width)
    assert not any("…" in line for line in lines)
    assert max(map(len, lines)) <= width
    assert {"vehicle", "phase", "mode", "batt.", "route", "strikes", "link"} <= words(lines)
    assert {"uav12", "flying", "AUTO.MISSION", "lost", "123"} <= words(lines)
