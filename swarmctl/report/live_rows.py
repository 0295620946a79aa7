"""The live view of a flight: one row for each vehicle, as data, as a Rich table and as plain lines."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
from rich.console import Group
from rich.text import Text

from swarmctl.agent.phases import ENDED, Phase
from swarmctl.agent.state import ARRIVED, AgentState
from swarmctl.report.final_state import is_lost_in_air
from swarmctl.report.tables import Column, FittedTable

OTHER_LINES = 9
"""lines of the terminal that are not rows of vehicles"""
LATE_HEARTBEAT_S = 3.0
"""least age of the last heartbeat that the link column shows [s]"""
BAR_CHARS = 10
MIN_COLUMNS_WITH_BAR = 92
"""least width of a terminal with a bar [columns]"""
OK, NOT_YET = "ok", "–"
"""texts of the link column: telemetry is recent; no heartbeat was received yet"""
COLUMNS = (
    Column("vehicle", "left"), Column("phase", "left"), Column("mode", "left"), Column("batt."),
    Column("route", "left"), Column("cells own\n+received", rank=4), Column("hostiles\nknown", rank=2),
    Column("replans", rank=3), Column("strikes"), Column("link", "left"),
)  # fmt: skip
NEW_WEIGHTS = Column("new w", "left", rank=1)
COLOURS = {
    Phase.WAITING: "yellow",
    Phase.UPLOADING: "cyan",
    Phase.STANDBY: "cyan",
    Phase.LAUNCHING: "cyan",
    Phase.FLYING: "green",
    Phase.FORMATION: "green",
    Phase.LANDING: "green",
    Phase.HOLDING: "yellow",
    Phase.LEAVING: "yellow",
    Phase.RELEASED: "red",
    Phase.DONE: "bright_black",
    Phase.FAILED: "red",
}


class VehicleRow(msgspec.Struct, frozen=True):
    """The live view of one vehicle."""

    name: str
    phase: Phase
    mode: str
    battery_percent: int | None
    progress: float
    """share of the route, 0..1: cells entered / (cells entered + cells ahead); 0 without a route"""
    cells_own: int
    cells_received: int
    hostiles_known: int
    replans: int
    strikes: int
    link: str
    note: str
    weights: str = ""
    """w and firing strengths after a change by an operator; empty: unchanged"""
    silence: str = ""
    """`lost` or `given up` if telemetry from an armed vehicle has stopped; else empty"""


class SwarmView(msgspec.Struct, frozen=True):
    """The live view of the whole swarm."""

    name: str
    flown_s: float
    """longest flight time of a vehicle, by the vehicle's clock [s]"""
    speed: float | None
    """seconds of the vehicles' clocks in one second of the wall clock; None: not known yet"""
    rows: Sequence[VehicleRow]
    on_ctrl_c: str = "hold, then return"


def vehicle_row(
    state: AgentState, age_s: float, note: str = "", refused: int = 0, *, lost_timeout_s: float = math.inf
) -> VehicleRow:
    """Return the live view of one vehicle.

    age_s: time since the last heartbeat, infinite before the first [s].
    refused: number of network messages that the vehicle refused.
    lost_timeout_s: age above which a lost vehicle is given up [s].
    """
    n_own = state.belief.n_cells_from(state.task.uav)
    return VehicleRow(
        name=state.task.name,
        phase=state.phase,
        mode=state.vehicle.mode,
        battery_percent=state.vehicle.battery_percent,
        progress=_progress(state),
        cells_own=n_own,
        cells_received=state.belief.n_observed - n_own,
        hostiles_known=state.belief.n_found,
        replans=state.plans.replans,
        strikes=state.vehicle.strikes,
        link=link_text(age_s, state.vehicle.delay_s, is_lost=state.lost, is_late=state.telemetry_is_late)
        + (f", {refused} refused" if refused else ""),
        weights=_weights(state),
        silence=("given up" if age_s > lost_timeout_s else "lost") if is_lost_in_air(state) else "",
        note=note or state.alarm or state.outcome or state.trouble or state.late or state.group,
    )


def _weights(state: AgentState) -> str:
    task, strength = state.task, state.strength
    if strength != task.strength:
        return f"{state.w:g}; {strength.direct:g}/{strength.first_neighbour:g}/{strength.second_neighbour:g}"
    return f"{state.w:g}" if state.w != task.w else ""


def _progress(state: AgentState) -> float:
    if state.phase is Phase.LANDING or state.outcome == ARRIVED:
        return 1.0
    if state.followed is None or state.progress is None or not state.vehicle.armed:
        return 0.0
    ahead_m = max(state.progress.to_last_waypoint_m, 0.0)
    return state.flown.length_m / max(state.flown.length_m + ahead_m, 1.0)


def link_text(age_s: float, delay_s: float, *, is_lost: bool, is_late: bool) -> str:
    """Return the quality of a vehicle's link in words.

    age_s: time since the last heartbeat, infinite before the first; delay_s: age of telemetry on arrival [s].
    """
    if age_s == math.inf:
        return NOT_YET
    if is_lost:
        return f"lost for {age_s:.0f} s"
    if age_s >= LATE_HEARTBEAT_S:
        return f"silent for {age_s:.0f} s"
    return f"{delay_s:.0f} s old" if is_late else OK


def live_table(view: SwarmView, width: int, height: int) -> Group:
    """Return the live table for a terminal of `width` columns and `height` lines.

    If not all vehicles fit, vehicles that have ended are hidden first.
    """
    speed = "" if view.speed is None else f" · {view.speed:.1f}× real time"
    head = Text.assemble(
        (view.name, "bold"), f"  flown {_minutes_text(view.flown_s)}{speed} · Ctrl-C: {view.on_ctrl_c}"
    )
    has_new_weights = any(row.weights for row in view.rows)
    table = FittedTable((*COLUMNS, *[NEW_WEIGHTS] * has_new_weights))
    max_rows = max(height - OTHER_LINES, 1)
    ended_last = sorted(view.rows, key=lambda row: row.phase in ENDED)
    shown = view.rows if len(view.rows) <= max_rows else ended_last[: max_rows - 1]
    for row in shown:
        table.add_row(
            row.name,
            Text(row.silence, style="red") if row.silence else Text(row.phase, style=COLOURS[row.phase]),
            row.mode,
            "–" if row.battery_percent is None else f"{row.battery_percent} %",
            _bar(row.progress, BAR_CHARS if width >= MIN_COLUMNS_WITH_BAR else 0),
            f"{row.cells_own}+{row.cells_received}",
            str(row.hostiles_known),
            str(row.replans),
            Text(str(row.strikes), style="red" if row.strikes else ""),
            Text(row.link, style="" if row.link in (OK, NOT_YET) else "red"),
            *([Text(row.weights, style="yellow")] if has_new_weights else []),
        )
    hidden = len(view.rows) - len(shown)
    notes = [Text(f"and {hidden} more", style="bright_black")] if hidden else []
    notes += [
        Text(f"{row.name}: {row.note}", style="yellow") for row in shown if row.note not in ("", ARRIVED)
    ]
    return Group(head, table.at(width), *notes)


def _bar(share: float, length: int) -> Text:
    full = round(share * length)
    return Text.assemble(
        ("━" * full, "green"), ("╌" * (length - full), "bright_black"), f"{100.0 * share:4.0f} %"
    )


def _minutes_text(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"


def plain_line(row: VehicleRow) -> str:
    """Return one vehicle as a plain line, for output without a terminal."""
    battery = "?" if row.battery_percent is None else f"{row.battery_percent} %"
    phase = f"{row.silence} (was {row.phase})" if row.silence else row.phase
    text = (
        f"{row.name}: {phase}, mode {row.mode or '?'}, route {100.0 * row.progress:.0f} %, "
        f"battery {battery}, cells {row.cells_own} own + {row.cells_received} received, "
        f"hostiles known {row.hostiles_known}, replans {row.replans}, strikes {row.strikes}, link {row.link}"
    )
    text += f", w {row.weights}" if row.weights else ""
    return f"{text}; {row.note}" if row.note else text
