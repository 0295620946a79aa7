"""A table of limited width: each column is complete or absent; only the last column may be cut."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.text import Text

GAP = 2  # space between two columns [characters]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table.

    priority: rank of the column; the column with the lowest priority is removed first
    right: True for right-aligned cells
    min_width: [characters]
    min_cut_width: lowest width to which the last column may be cut; None: cut only if it is alone
    """

    heading: str
    cells: Sequence[Text]
    priority: int
    right: bool = False
    min_width: int = 0
    min_cut_width: int | None = None

    @property
    def width(self) -> int:
        return max(self.min_width, len(self.heading), *(cell.cell_len for cell in self.cells), 0)

    @property
    def needed_width(self) -> int:
        return self.width if self.min_cut_width is None else min(self.width, self.min_cut_width)


def fitting(columns: Sequence[Column], width: int | None) -> list[Column]:
    """Return the columns that fit into `width` characters, at least one column; for None all columns."""
    kept = list(columns)
    while width is not None and len(kept) > 1 and _needed_width(kept) > width:
        kept.remove(min(kept, key=lambda column: column.priority))
    return kept


def table(columns: Sequence[Column], width: int | None) -> list[Text]:
    """Return the heading and rows as lines of at most `width` characters; None: no limit."""
    kept = fitting(columns, width)
    widths = [column.width for column in kept]
    if width is not None:
        widths[-1] = min(widths[-1], width - sum(widths[:-1]) - GAP * (len(kept) - 1))
    rows = [[Text(column.heading, style="bold") for column in kept]]
    rows += [list(cells) for cells in zip(*(column.cells for column in kept), strict=True)]
    return [_line(cells, kept, widths) for cells in rows]


def _needed_width(columns: Sequence[Column]) -> int:
    return sum(column.needed_width for column in columns) + GAP * (len(columns) - 1)


def _line(cells: Sequence[Text], columns: Sequence[Column], widths: Sequence[int]) -> Text:
    line = Text(no_wrap=True)
    for i, (cell, column, width) in enumerate(zip(cells, columns, widths, strict=True)):
        shown = cell.copy()
        shown.truncate(width, overflow="ellipsis")
        space = " " * (width - shown.cell_len)
        line.append(" " * GAP if i else "")
        line.append_text(Text(space) + shown if column.right else shown + space)
    line.rstrip()
    return line


def one_line(words: Sequence[str], width: int, style: str) -> Text:
    """Return the words that fit into `width`, as one line; cut the first word if necessary."""
    shown = list(words)
    while len(shown) > 1 and len("  ".join(shown)) > width:
        shown.pop()
    line = Text("  ".join(shown), style=style, no_wrap=True)
    line.truncate(width, overflow="ellipsis")
    return line
