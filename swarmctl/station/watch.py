"""The states of vehicles whose agents run on other machines, as a table or as lines."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Mapping, Sequence

import msgspec
from rich.console import Group
from rich.text import Text

from swarmctl.agent.state import ARRIVED
from swarmctl.bus import keys
from swarmctl.bus.transports.base import Transport
from swarmctl.core.frames import Frame, FrameCodec, IntentShared, MemberShared, MessageRefused, StateShared
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.observation import Observation
from swarmctl.core.operator_text import printable
from swarmctl.report.live_rows import COLOURS
from swarmctl.report.tables import Column, FittedTable

SILENT_AFTER_S = 5.0
"""time without a state after which a vehicle is shown as silent; vehicles send a state each second"""
REFRESH_S = 0.5
MAX_STATE_AGE_S = 60.0
"""largest difference between a state's time and this machine's clock; other states are refused"""
MAX_SHOWN = 10**6
"""limit of shown numbers; for a number at or above the limit, the table shows `?`"""
ONCE_TIMEOUT_S = 5.0
"""longest wait of `--once` for the states of all vehicles"""
PHASE_STYLES = {str(phase): colour for phase, colour in COLOURS.items()}
COLUMNS = (
    Column("vehicle", "left"), Column("phase", "left"), Column("mode", "left", rank=3),
    Column("cell", "left"), Column("height\n[m]"), Column("heard\n[s] ago"), Column("cells\nknown", rank=4),
    Column("hostiles\nknown", rank=2), Column("plan", rank=5), Column("refused", rank=1),
)  # fmt: skip
LATE, CONTRADICTED = Column("late\n[s]"), Column("contradicted by", "left")
"""columns that are shown only if a vehicle has a value in them"""
LEGEND = (
    "phase: of the agent; mode: last known mode of the autopilot; cell: row, col; height: above home; "
    "known: from own and others' observations; plan: number of the current plan, 1 the first; refused: "
    "messages that the vehicle refused"
)
LATE_LEGEND = "; late: predicted flight time to the goal, outside the time bound"
CONTRADICTED_LEGEND = (
    "; contradicted by: vehicles whose observations contradict this vehicle's observations, or each other"
)


class StateRow(msgspec.Struct, frozen=True):
    """The latest state of one vehicle."""

    name: str
    age_s: float | None
    """time since the reception of the last state [s]; None before the first state"""
    state: StateShared | None
    cell: Cell | None
    contradicted_by: tuple[str, ...] = ()
    """vehicles whose observations contradict this vehicle's observations, or each other"""

    @property
    def is_silent(self) -> bool:
        return self.age_s is None or self.age_s > SILENT_AFTER_S

    @property
    def note(self) -> str:
        if self.state is None:
            return ""
        text = self.state.outcome or self.state.trouble or self.state.group
        return "" if text == ARRIVED else printable(text)


class StationView(msgspec.Struct, frozen=True):
    """The whole swarm at one moment."""

    swarm: str
    network: str
    """endpoint and state of the connection, as text"""
    rows: Sequence[StateRow]
    refused: int
    """number of refused messages: invalid, repeated, old, or not a state of a vehicle of this swarm"""


class StateBoard:
    """The newest state of each vehicle, and the check of all that vehicles send to stations. Pure."""

    def __init__(self, swarm: str, names: Mapping[int, str], grid: Grid, codec: FrameCodec) -> None:
        self.refused = 0
        self._swarm = swarm
        self._names = names
        self._grid = grid
        self._codec = codec
        self._states: dict[int, tuple[StateShared, float]] = {}
        """newest state of each vehicle, and the time of its reception"""
        self._newest: dict[tuple[int, bool], tuple[int, int]] = {}
        """incarnation and number of the newest frame, by vehicle, of states (True) and of other messages"""

    def receive(self, key: str, payload: bytes, now_s: float, unix_s: float) -> Frame | None:
        """Return the frame that a vehicle sent to stations, and store a state; refuse and count all others.

        `now_s` is a monotonic time, `unix_s` the wall clock's.
        """
        try:
            frame = self._codec.decode(payload)
        except MessageRefused:
            self.refused += 1
            return None
        # A replayed frame has a valid signature, but its content is old.
        series, number = (frame.sender, isinstance(frame.content, StateShared)), (frame.incarnation, frame.n)
        is_new = series not in self._newest or number > self._newest[series]
        is_current = abs(unix_s - frame.unix_s) <= MAX_STATE_AGE_S
        if not (is_new and is_current) or frame.sender not in self._names or key != self._key_of(frame):
            self.refused += 1
            return None
        self._newest[series] = number
        if isinstance(frame.content, StateShared):
            self._states[frame.sender] = frame.content, now_s
        return frame

    def _key_of(self, frame: Frame) -> str:
        """Return the key under which a station gets this frame; "" for messages that stations do not get."""
        match frame.content:
            case StateShared():
                return keys.to_station(self._swarm, frame.sender)
            case Observation() | IntentShared() | MemberShared():
                return keys.copy_to_station(self._swarm, frame.act, frame.sender)
        return ""

    @property
    def has_all(self) -> bool:
        return len(self._states) == len(self._names)

    @property
    def has_any(self) -> bool:
        return bool(self._states)

    def view(self, network: str, now_s: float) -> StationView:
        return StationView(self._swarm, network, [self._row(uav, now_s) for uav in self._names], self.refused)

    def _row(self, uav: int, now_s: float) -> StateRow:
        name, newest = self._names[uav], self._states.get(uav)
        if newest is None:
            return StateRow(name, None, None, None)
        state, received_s = newest
        flagged = state.flagged[: len(self._names)]
        contradicted_by = tuple(self._names.get(other, str(other)) for other in flagged)
        cell = self._grid.cell_at(state.lat_deg, state.lon_deg)
        return StateRow(name, now_s - received_s, state, cell, contradicted_by)


async def watch(
    bus: Transport,
    board: StateBoard,
    swarm: str,
    network: Callable[[], str],
    show: Callable[[StationView], None],
    *,
    once: bool,
    wall_clock: Callable[[], float] = time.time,
) -> None:
    """Show states until cancelled.

    `once`: show a single view, when all vehicles have sent a state or after `ONCE_TIMEOUT_S`.
    `wall_clock` returns seconds since 1970.
    """
    clock = asyncio.get_running_loop().time

    def receive(key: str, payload: bytes) -> None:
        board.receive(key, payload, clock(), wall_clock())

    bus.subscribe(keys.station(swarm), receive)
    until_s = clock() + ONCE_TIMEOUT_S
    while True:
        if not once:
            show(board.view(network(), clock()))
        elif board.has_all or clock() >= until_s:
            show(board.view(network(), clock()))
            return
        await asyncio.sleep(REFRESH_S)


def table(view: StationView) -> Group:
    """Return a view as a table for a terminal."""
    any_late = any(row.state is not None and row.state.late_s is not None for row in view.rows)
    any_contradicted = any(row.contradicted_by for row in view.rows)
    grid = FittedTable((*COLUMNS, *[LATE] * any_late, *[CONTRADICTED] * any_contradicted))
    for row in view.rows:
        cells = [
            *_cells(row),
            *[_late(row)] * any_late,
            *[Text(", ".join(row.contradicted_by), style="red")] * any_contradicted,
        ]
        grid.add_row(*cells, style="bright_black" if row.is_silent else "")
    legend = LEGEND + LATE_LEGEND * any_late + CONTRADICTED_LEGEND * any_contradicted
    head = Text.assemble((view.swarm, "bold"), f"  {view.network}")
    notes = [Text(f"{row.name}: {row.note}", style="yellow") for row in view.rows if row.note]
    if view.refused:
        text = f"{view.refused} messages were refused: invalid, old, or no state of a vehicle of this swarm"
        notes.append(Text(text, style="red"))
    return Group(head, grid, Text(legend, style="bright_black"), *notes)


def _cells(row: StateRow) -> list[Text]:
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


def _late(row: StateRow) -> Text:
    late_s = None if row.state is None else row.state.late_s
    return Text("" if late_s is None else number(late_s), style="red")


class StateLines:
    """Plain lines: for each vehicle a line at a change of phase or silence, and every `every_s` [s]."""

    def __init__(self, say: Callable[[str], None], every_s: float) -> None:
        self._say = say
        self._views_per_line = max(round(every_s / REFRESH_S), 1)
        self._n_views = 0
        self._network = ""
        self._last: dict[str, tuple[str, bool]] = {}

    def show(self, view: StationView) -> None:
        is_due = self._n_views % self._views_per_line == 0
        self._n_views += 1
        if view.network != self._network:
            self._network = view.network
            self._say(f"{view.swarm}: {view.network}")
        for row in view.rows:
            current = "" if row.state is None else row.state.phase, row.is_silent
            if is_due or self._last.get(row.name) != current:
                self._say(line(row))
            self._last[row.name] = current


def line(row: StateRow) -> str:
    """Return one vehicle as a plain line."""
    state = row.state
    if state is None:
        return f"{row.name}: no state received"
    age = "" if row.age_s is None or not row.is_silent else f", last state {row.age_s:.0f} s old"
    where = "outside the area" if row.cell is None else f"cell {row.cell[0]},{row.cell[1]}"
    text = (
        f"{row.name}: {printable(state.phase)}{age}, mode {printable(state.mode) or 'unknown'}, {where}, "
        f"{number(state.alt_rel_m)} m above home, {number(state.n_observed)} cells and "
        f"{number(state.n_found)} hostiles known, "
        f"plan {number(state.plan_id)}, {number(state.refused)} messages refused"
    )
    text += "" if state.late_s is None else f", late: predicted {number(state.late_s)} s to the goal"
    text += f", contradicted by {', '.join(row.contradicted_by)}" if row.contradicted_by else ""
    return f"{text}; note: {row.note}" if row.note else text


def number(value: float) -> str:
    """Return a received number as text, rounded; `?` for an invalid number."""
    return str(round(value)) if math.isfinite(value) and abs(value) < MAX_SHOWN else "?"
