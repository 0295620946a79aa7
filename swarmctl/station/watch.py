"""The ground station of a swarm whose agents run elsewhere: what each tells of itself, as a table."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from swarmctl.agent.state import ARRIVED
from swarmctl.bus import keys
from swarmctl.bus.transports.base import Transport
from swarmctl.core.frames import Frame, MessageRefused, FrameCodec, StateShared
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.texts import printable
from swarmctl.report.live_rows import COLOURS

SILENT_S = 5.0
"""A vehicle tells of itself once a second; what is older is shown as old."""
REFRESH_S = 0.5
STATE_AGE_S = 60.0
"""by the wall clocks of both machines: what is older, or said later than now by more, is refused"""
MAX_SHOWN = 10**6
"""larger numbers are nonsense, and would push the table apart"""
ONCE_S = 5.0
"""how long a single look waits for who has not been heard"""
PHASE_STYLES = {str(phase): colour for phase, colour in COLOURS.items()}
COLUMNS = (
    ("vehicle", "left"), ("phase", "left"), ("mode", "left"), ("cell", "left"), ("height\n[m]", "right"),
    ("heard\n[s] ago", "right"), ("cells\nknown", "right"), ("hostiles\nknown", "right"), ("plan", "right"),
    ("refused", "right"),
)  # fmt: skip
LATE, DOUBTS = ("late\n[s]", "right"), ("doubts", "left")
"""shown where there is any"""
LEGEND = (
    "phase: what its agent does; mode: its autopilot's, when last heard; cell: row, col; height: above its "
    "home; known: seen by itself or told by others; plan: the last of its flight, 1 the first; refused: "
    "messages it did not take"
)
LATE_LEGEND = "; late: over its goal so long after take-off, which is not within its time bound"
DOUBTS_LEGEND = "; doubts: who told it the contrary of what it saw"


@dataclass(frozen=True, slots=True)
class Row:
    """What is known of one vehicle."""

    name: str
    age_s: float | None
    """since it was heard; None before"""
    state: StateShared | None
    cell: Cell | None
    doubts: tuple[str, ...] = ()
    """vehicles that told the contrary of what it saw itself"""

    @property
    def is_silent(self) -> bool:
        return self.age_s is None or self.age_s > SILENT_S

    @property
    def note(self) -> str:
        if self.state is None:
            return ""
        said = self.state.outcome or self.state.trouble
        return "" if said == ARRIVED else printable(said)


@dataclass(frozen=True, slots=True)
class View:
    """The whole swarm at one moment."""

    swarm: str
    network: str
    """whether and where the swarm's network is reached, in words"""
    rows: Sequence[Row]
    refused: int
    """what came and was no state of a vehicle of this swarm"""


class Board:
    """Keeps the newest that each vehicle has told. Pure: time is an argument."""

    def __init__(self, swarm: str, names: Mapping[int, str], grid: Grid, seal: FrameCodec) -> None:
        self.refused = 0
        self._swarm = swarm
        self._names = names
        self._grid = grid
        self._seal = seal
        self._newest: dict[int, tuple[Frame, StateShared, float]] = {}

    def take(self, key: str, payload: bytes, now_s: float, unix_s: float) -> None:
        """What came under a key of the station; refused and counted if it is no vehicle's state of now.

        `now_s` is by any clock that goes evenly, `unix_s` by the wall's.
        """
        try:
            frame = self._seal.decode(payload)
        except MessageRefused:
            self.refused += 1
            return
        state = frame.content
        named = frame.sender in self._names and key == keys.to_station(self._swarm, frame.sender)
        if not named or not isinstance(state, StateShared):
            self.refused += 1
            return
        held = self._newest.get(frame.sender)
        is_newer = held is None or (frame.incarnation, frame.n) > (held[0].incarnation, held[0].n)
        # What was recorded is put again by whoever likes: it is true, and no longer so.
        if not is_newer or abs(unix_s - frame.unix_s) > STATE_AGE_S:
            self.refused += 1
            return
        self._newest[frame.sender] = frame, state, now_s

    @property
    def all_heard(self) -> bool:
        return len(self._newest) == len(self._names)

    @property
    def any_heard(self) -> bool:
        return bool(self._newest)

    def view(self, network: str, now_s: float) -> View:
        return View(self._swarm, network, [self._row(uav, now_s) for uav in self._names], self.refused)

    def _row(self, uav: int, now_s: float) -> Row:
        name, held = self._names[uav], self._newest.get(uav)
        if held is None:
            return Row(name, None, None, None)
        _, state, heard_s = held
        flagged = state.flagged[: len(self._names)]
        doubts = tuple(self._names.get(other, str(other)) for other in flagged)
        cell = self._grid.cell_at(state.lat_deg, state.lon_deg)
        return Row(name, now_s - heard_s, state, cell, doubts)


async def watch(
    bus: Transport,
    board: Board,
    swarm: str,
    network: Callable[[], str],
    show: Callable[[View], None],
    *,
    once: bool,
    wall_clock: Callable[[], float] = time.time,
) -> None:
    """Show what comes until cancelled; `once`: one view, when all were heard or `ONCE_S` is over.

    `wall_clock` tells seconds since 1970.
    """
    clock = asyncio.get_running_loop().time
    bus.subscribe(keys.station(swarm), lambda key, payload: board.take(key, payload, clock(), wall_clock()))
    until_s = clock() + ONCE_S
    while True:
        if not once:
            show(board.view(network(), clock()))
        elif board.all_heard or clock() >= until_s:
            show(board.view(network(), clock()))
            return
        await asyncio.sleep(REFRESH_S)


def table(view: View) -> Group:
    """A view for a terminal."""
    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    late = any(row.state is not None and row.state.late_s is not None for row in view.rows)
    doubts = any(row.doubts for row in view.rows)
    for title, justify in (*COLUMNS, *[LATE] * late, *[DOUBTS] * doubts):
        grid.add_column(Text(title), justify=justify, no_wrap=True)  # type: ignore[arg-type]
    for row in view.rows:
        cells = [*_cells(row), *[_late(row)] * late, *[Text(", ".join(row.doubts), style="red")] * doubts]
        grid.add_row(*cells, style="bright_black" if row.is_silent else None)
    legend = LEGEND + LATE_LEGEND * late + DOUBTS_LEGEND * doubts
    head = Text.assemble((view.swarm, "bold"), f"  {view.network}")
    notes = [Text(f"{row.name}: {row.note}", style="yellow") for row in view.rows if row.note]
    if view.refused:
        text = f"refused here: {view.refused} messages that were no vehicle's own state of now"
        notes.append(Text(text, style="red"))
    return Group(head, grid, Text(legend, style="bright_black"), *notes)


def _cells(row: Row) -> list[Text]:
    state = row.state
    age = Text("never" if row.age_s is None else f"{row.age_s:.0f}", style="red" if row.is_silent else "")
    if state is None:
        return [Text(row.name), *[Text("–")] * 4, age, *[Text("–")] * 4]
    phase = printable(state.phase)
    return [
        Text(row.name),
        Text(phase, style=PHASE_STYLES.get(phase, "red")),
        Text(printable(state.mode)),
        Text("outside" if row.cell is None else f"{row.cell[0]},{row.cell[1]}"),
        Text(number(state.alt_rel_m)),
        age,
        Text(number(state.n_observed)),
        Text(number(state.n_found)),
        Text(number(state.plan_id) if state.plan_id else "–"),
        Text(number(state.refused)),
    ]


def _late(row: Row) -> Text:
    late_s = None if row.state is None else row.state.late_s
    return Text("" if late_s is None else number(late_s), style="red")


class Lines:
    """For logs and pipes: a line where something changed, and one a vehicle now and then."""

    def __init__(self, say: Callable[[str], None], every_s: float) -> None:
        self._say = say
        self._every = max(round(every_s / REFRESH_S), 1)
        self._views = 0
        self._network = ""
        self._last: dict[str, tuple[str, bool]] = {}

    def show(self, view: View) -> None:
        due = self._views % self._every == 0
        self._views += 1
        if view.network != self._network:
            self._network = view.network
            self._say(f"{view.swarm}: {view.network}")
        for row in view.rows:
            now = "" if row.state is None else row.state.phase, row.is_silent
            if due or self._last.get(row.name) != now:
                self._say(line(row))
            self._last[row.name] = now


def line(row: Row) -> str:
    """One vehicle as a plain line."""
    state = row.state
    if state is None:
        return f"{row.name}: not heard"
    age = "" if row.age_s is None or not row.is_silent else f", last heard {row.age_s:.0f} s ago"
    where = "outside the area" if row.cell is None else f"cell {row.cell[0]},{row.cell[1]}"
    text = (
        f"{row.name}: {printable(state.phase)}{age}, mode {printable(state.mode) or 'unknown'}, {where}, "
        f"{number(state.alt_rel_m)} m up, {number(state.n_observed)} cells and {number(state.n_found)} "
        f"hostiles known, plan {number(state.plan_id)}, {number(state.refused)} messages refused"
    )
    text += "" if state.late_s is None else f", late: over its goal after {number(state.late_s)} s"
    text += f", saw the contrary of what {', '.join(row.doubts)} told" if row.doubts else ""
    return f"{text} ({row.note})" if row.note else text


def number(value: float) -> str:
    """What another machine says, to the next whole number; `?` where nobody can have meant it."""
    return str(round(value)) if math.isfinite(value) and abs(value) < MAX_SHOWN else "?"
