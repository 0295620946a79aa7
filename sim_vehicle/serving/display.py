"""A live table of the fleet for a terminal, in pages, with a summary line."""

import asyncio
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from rich.console import Console, Group
from rich.text import Text

from sim_vehicle.serving.columns import Column, one_line, table
from sim_vehicle.serving.server import Server
from sim_vehicle.truth import Truth

REFRESH_S = 0.5  # time between two drawings
PAGE_S = 5.0  # time on one page
FRAME_LINES = 5  # two header lines, headings, summary, and the last warning
MAX_MODES = 4  # number of modes that the summary counts by name
LATE_S = 0.05  # 99th percentile of the ticks' lateness above which the header is red
LOW_BATTERY_SHARE = 0.2  # battery share below which the column shows red
MIN_FAULTS_CHARS = 12  # minimum width of the column of faults, which may be cut


class Display:
    """The live table, with the earlier message counts for the rates."""

    def __init__(self, server: Server, warning: Callable[[], str] = str) -> None:
        """`warning`: function that returns the last warning, or an empty text."""
        self._server, self._warning = server, warning
        scenario = server.fleet.scenario
        self._types = [f"{spec.personality} {spec.kind}" for spec in scenario.vehicles]
        self._sent, self._sent_s = list(server.sent), 0.0
        self._rates = [0.0] * len(self._types)  # messages/s
        self._began_s: float | None = None
        self._widest: dict[str, int] = {}  # columns never shrink, so that they do not move

    def render(self, wall_s: float, width: int, height: int) -> Group:
        """Return the table at `wall_s` [s of any origin] for a terminal of `width` x `height` characters."""
        if self._began_s is None:
            self._began_s = self._sent_s = wall_s
        self._update_rates(wall_s)
        truth = self._server.fleet.truth()
        count = len(self._types)
        rows = max(1, height - FRAME_LINES)
        pages = math.ceil(count / rows)
        page = int((wall_s - self._began_s) / PAGE_S) % pages
        shown = range(page * rows, min(count, (page + 1) * rows))
        parts = [*self._header(width, wall_s), *table(self._columns(truth, shown), width)]
        parts.append(one_line(summary(truth, page, pages), width, "dim"))
        if warning := self._warning():
            parts.append(one_line([warning], width, "red"))
        return Group(*parts)

    def _update_rates(self, wall_s: float) -> None:
        if wall_s - self._sent_s >= 1.0:
            sent = list(self._server.sent)
            self._rates = [(n - o) / (wall_s - self._sent_s) for n, o in zip(sent, self._sent, strict=True)]
            self._sent, self._sent_s = sent, wall_s

    def _header(self, width: int, wall_s: float) -> list[Text]:
        server = self._server
        late_s = server.lateness.quantile_s(0.99)
        words = [f"{_hours_text(server.simulated_s)}, {server.pace}", f"{sum(self._rates):.0f} messages/s"]
        if not math.isnan(late_s):
            words.append(f"p99 late {1000 * late_s:.0f} ms")
        if server.pace.lost_s:
            words.append(f"{server.pace.lost_s:.1f} s lost")
        if server.dropped:
            words.append(f"{server.dropped} dropped")
        slow = bool(server.pace.lost_s) or late_s > LATE_S
        return [
            one_line([f"sim_vehicle  {words[0]}", *words[1:]], width, "bold red" if slow else "bold"),
            one_line([f"ground stations: {server.stations()}  {server.describe_ports()}"], width, "dim"),
        ]

    def _columns(self, truth: Truth, shown: range) -> list[Column]:
        several_links = len(set(self._server.fleet.links)) > 1
        faults = [" ".join(self._server.fleet.faults_on(i)) for i in shown]
        columns = [
            Column("id", [Text(self._id(truth, i, several_links)) for i in shown], priority=10, right=True),
            Column("type", [Text(self._types[i]) for i in shown], priority=4),
            Column("mode", [Text(truth.mode[i]) for i in shown], priority=8),
            Column("armed", [_armed(bool(truth.armed[i])) for i in shown], priority=3, right=True),
            Column("height m", [Text(f"{truth.height_m[i]:.1f}") for i in shown], priority=7, right=True),
            Column("m/s", [Text(f"{truth.speed_m_s[i]:.1f}") for i in shown], priority=5, right=True),
            Column(
                "batt", [_battery(float(truth.battery_remaining[i])) for i in shown], priority=9, right=True
            ),
            Column("latitude, longitude", [Text(_place(truth, i)) for i in shown], priority=0, right=True),
            Column("msg/s", [Text(f"{self._rates[i]:.0f}") for i in shown], priority=2, right=True),
            Column("hit", [_strikes(int(truth.strikes[i])) for i in shown], priority=1, right=True),
        ]
        if any(faults) or "faults" in self._widest:
            cells = [Text(words, style="red") for words in faults]
            columns.append(Column("faults", cells, priority=6, min_cut_width=MIN_FAULTS_CHARS))
        for i, column in enumerate(columns):
            self._widest[column.heading] = max(column.width, self._widest.get(column.heading, 0))
            columns[i] = replace(column, min_width=self._widest[column.heading])
        return columns

    def _id(self, truth: Truth, i: int, several_links: bool) -> str:
        return f"{self._server.fleet.links[i]}:{truth.sysid[i]}" if several_links else f"{truth.sysid[i]}"


def _place(truth: Truth, i: int) -> str:
    return f"{truth.lat_deg[i]:.6f}, {truth.lon_deg[i]:.6f}"


def _armed(armed: bool) -> Text:
    return Text("yes", style="yellow") if armed else Text("no")


def _battery(share: float) -> Text:
    return Text(f"{share:.0%}", style="red" if share < LOW_BATTERY_SHARE else "")


def _strikes(strikes: int) -> Text:
    return Text(str(strikes), style="red" if strikes else "dim")


def summary(truth: Truth, page: int, pages: int) -> list[str]:
    """Return a summary of all vehicles, and the page number."""
    modes = Counter(truth.mode).most_common()
    named = [f"{number} {mode}" for mode, number in modes[:MAX_MODES]]
    named += [f"{sum(number for _, number in modes[MAX_MODES:])} other"] if len(modes) > MAX_MODES else []
    words = [
        f"{len(truth.mode)} vehicle{'s' if len(truth.mode) != 1 else ''}",
        ", ".join(named),
        f"{int(truth.armed.sum())} armed",
        f"{int(truth.airborne.sum())} flying",
        f"battery >= {float(truth.battery_remaining.min()):.0%}",
    ]
    return [f"page {page + 1}/{pages}", *words] if pages > 1 else words


def _hours_text(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}"


async def show_table(server: Server, warning: Callable[[], str]) -> None:
    """Refresh the table until cancelled; return at once if there is no terminal.

    A thread draws the table, so that heartbeats stay punctual. The table uses the alternate screen, because
    a narrowed main screen keeps parts of old lines. The last table stays on the main screen.
    """
    console = Console()
    if not console.is_terminal or console.is_dumb_terminal:
        return
    display, loop = Display(server, warning), asyncio.get_running_loop()
    size = console.size
    with console.screen():
        while True:
            if console.size != size:  # some terminals keep text beyond the new edge
                size = console.size
                console.clear()
            picture = display.render(loop.time(), *size)
            drawing = asyncio.ensure_future(asyncio.to_thread(console.update_screen, picture))
            try:
                await asyncio.shield(drawing)
                await asyncio.sleep(REFRESH_S)
            except asyncio.CancelledError:
                await drawing  # ends before the return to the main screen
                break
        console.clear()
    console.print(display.render(loop.time(), *console.size))
