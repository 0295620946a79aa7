"""Tables that fit the terminal, and texts of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import msgspec
from rich import box
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from swarmctl.core.inference.survival import ProbabilityEstimate

MIN_DECIMAL = 1e-3
"""least product that is written with four decimals"""


def product_text(safety_factor: float) -> str:
    """Return ∏(1 − P_s) with four decimals, or three significant digits below MIN_DECIMAL; "0" for zero."""
    if safety_factor == 0.0:
        return "0"
    return f"{safety_factor:.4f}" if safety_factor >= MIN_DECIMAL else f"{safety_factor:.3g}"


def estimate_texts(chance: ProbabilityEstimate) -> tuple[str, str]:
    """Return a probability and its 95 % interval as texts for two columns."""
    estimate, _, interval = str(chance).partition(" ")
    return estimate, interval.strip("()")


class Column(msgspec.Struct, frozen=True):
    """A column of a fitted table."""

    title: str
    justify: Literal["left", "right"] = "right"
    rank: int = 0
    """order of omission: the column with the greatest rank is left out first; 0: never left out"""
    wraps_at: int = 0
    """width at which longer texts may wrap [characters]; 0: no wrap"""


class FittedTable:
    """A table that leaves out columns on a narrow console. Columns of rank 0 stay, and may be cut."""

    def __init__(
        self, columns: Sequence[Column], *, caption: Sequence[str] = (), elsewhere: str = ""
    ) -> None:
        """`caption`: lines below the table. `elsewhere`: file or command that shows all columns."""
        self._columns = columns
        self._caption = caption
        self._elsewhere = elsewhere
        self._rows: list[tuple[list[Text], str]] = []
        self._section_ends: set[int] = set()

    def add_row(self, *cells: str | Text, style: str = "") -> None:
        texts = [cell if isinstance(cell, Text) else Text(cell) for cell in cells]
        self._rows.append((texts, style))

    def end_section(self) -> None:
        """Draw a gap below the row added last."""
        self._section_ends.add(len(self._rows) - 1)

    def at(self, width: int | None = None) -> Table:
        """Return the table for a console of `width` columns; None: with all columns."""
        shown, gap = self._fitting(width)
        table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False, padding=(0, gap - 1, 0, 0))
        for index in shown:
            column = self._columns[index]
            wraps = column.wraps_at > 0
            table.add_column(
                Text(column.title), justify=column.justify, no_wrap=not wraps, min_width=self._width(index)
            )
        for number, (cells, style) in enumerate(self._rows):
            table.add_row(
                *(cells[index] for index in shown), style=style, end_section=number in self._section_ends
            )
        lines = list(self._caption)
        if self._elsewhere and len(shown) < len(self._columns):
            hidden = (column for index, column in enumerate(self._columns) if index not in shown)
            names = ", ".join(" ".join(column.title.split()).replace("- ", "-") for column in hidden)
            lines.append(f"left out at {width} columns: {names}; see {self._elsewhere}")
        table.caption, table.caption_justify = Text("\n".join(lines)) if lines else None, "left"
        return table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        yield self.at(options.max_width)

    def _fitting(self, width: int | None) -> tuple[list[int], int]:
        """Return the indices of the columns that fit, and the gap between columns: 2, or 1 to save room."""
        shown = list(range(len(self._columns)))
        if width is None or sum(self._width(index) + 2 for index in shown) <= width:
            return shown, 2
        # One edge, and a gap or an edge after each column.
        while 1 + sum(self._width(index) + 1 for index in shown) > width:
            optional = [index for index in shown if self._columns[index].rank > 0]
            if not optional:
                break
            shown.remove(max(optional, key=lambda index: self._columns[index].rank))
        return shown, 1

    def _width(self, index: int) -> int:
        """Return the least width at which a column's heading and values are not cut."""
        column = self._columns[index]
        widest = max((cell.cell_len for cells, _ in self._rows for cell in [cells[index]]), default=0)
        if column.wraps_at:
            widest = min(widest, column.wraps_at)
        return max(widest, *map(cell_len, column.title.split("\n")))
