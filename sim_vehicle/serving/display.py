"""A live table of the fleet for a terminal: as many vehicles as fit, page after page, and a line on all."""

import asyncio
import math
from collections import Counter

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from sim_vehicle.fleet import Truth
from sim_vehicle.serving.server import Server

REFRESH_S = 0.5
PAGE_S = 5.0
FRAME_LINES = 5  # two of the header, headings, summary, and the cursor's own
WIDE = 100  # columns from which there is room for the place and the messages
MODES_NAMED = 4
LATE_S = 0.05
LOW_BATTERY = 0.2


class Display:
    """What the terminal shows; remembers what it takes to say messages per second."""

    def __init__(self, server: Server) -> None:
        self._server = server
        scenario = server.fleet.scenario
        self._types = [f"{spec.personality} {spec.kind}" for spec in scenario.vehicles]
        self._sent, self._sent_s = list(server.sent), 0.0
        self._rates = [0.0] * len(self._types)
        self._began_s: float | None = None

    def render(self, wall_s: float, width: int, height: int) -> Group:
        """The picture at `wall_s` [s of any clock] for a terminal of `width` by `height` characters."""
        if self._began_s is None:
            self._began_s = self._sent_s = wall_s
        self._count(wall_s)
        truth = self._server.fleet.truth()
        count = len(self._types)
        rows = max(1, height - FRAME_LINES)
        pages = math.ceil(count / rows)
        page = int((wall_s - self._began_s) / PAGE_S) % pages
        shown = range(page * rows, min(count, (page + 1) * rows))
        parts: list[Table | Text] = [*self._header(width, wall_s), self._table(truth, shown, width)]
        parts.append(_cut(summary(truth, page, pages), width))
        return Group(*parts)

    def _count(self, wall_s: float) -> None:
        if wall_s - self._sent_s >= 1.0:
            sent = list(self._server.sent)
            self._rates = [(n - o) / (wall_s - self._sent_s) for n, o in zip(sent, self._sent, strict=True)]
            self._sent, self._sent_s = sent, wall_s

    def _header(self, width: int, wall_s: float) -> list[Text]:
        server = self._server
        late_s = server.lateness.quantile_s(0.99)
        words = [f"{_clock(server.simulated_s)} at {server.pace}", f"{sum(self._rates):.0f} messages/s"]
        if not math.isnan(late_s):
            words.append(f"p99 late {1000 * late_s:.0f} ms")
        if server.pace.lost_s:
            words.append(f"{server.pace.lost_s:.1f} s lost")
        if server.dropped:
            words.append(f"{server.dropped} dropped")
        heard = server.stations()
        stations = f"{heard} ground station{'s' if heard != 1 else ''}"
        slow = bool(server.pace.lost_s) or late_s > LATE_S
        return [
            _cut(Text(f"sim_vehicle  {'  '.join(words)}", style="bold red" if slow else "bold"), width),
            _cut(Text(f"{server.ports_words()}  {stations}", style="dim"), width),
        ]

    def _table(self, truth: Truth, shown: range, width: int) -> Table:
        wide = width >= WIDE
        table = Table(box=None, padding=(0, 1), pad_edge=False, header_style="bold")
        table.add_column("id", justify="right", no_wrap=True)
        table.add_column("type", no_wrap=True)
        table.add_column("mode", no_wrap=True)
        for heading in ("armed", "height m", "m/s", "batt"):
            table.add_column(heading, justify="right", no_wrap=True)
        if wide:
            table.add_column("latitude, longitude", justify="right", no_wrap=True)
            table.add_column("msg/s", justify="right", no_wrap=True)
        table.add_column("hit", justify="right", no_wrap=True)
        table.add_column("faults", no_wrap=True, overflow="ellipsis")
        several = len(set(self._server.fleet.links)) > 1
        for i in shown:
            link = f"{self._server.fleet.links[i]}:" if several else ""
            battery = float(truth.battery_remaining[i])
            place = [f"{truth.lat_deg[i]:.6f}, {truth.lon_deg[i]:.6f}", f"{self._rates[i]:.0f}"]
            strikes = int(truth.strikes[i])
            table.add_row(
                f"{link}{truth.sysid[i]}",
                self._types[i],
                truth.mode[i],
                Text("yes", style="yellow") if truth.armed[i] else "no",
                f"{truth.height_m[i]:.1f}",
                f"{truth.speed_m_s[i]:.1f}",
                Text(f"{battery:.0%}", style="red" if battery < LOW_BATTERY else ""),
                *(place if wide else ()),
                Text(str(strikes), style="red" if strikes else "dim"),
                Text(" ".join(self._server.fleet.faults_on(i)), style="red"),
            )
        return table


def summary(truth: Truth, page: int, pages: int) -> Text:
    """One line about all vehicles, and which page this is."""
    modes = Counter(truth.mode).most_common()
    named = [f"{number} {mode}" for mode, number in modes[:MODES_NAMED]]
    named += [f"{sum(number for _, number in modes[MODES_NAMED:])} other"] if len(modes) > MODES_NAMED else []
    words = [
        f"{len(truth.mode)} vehicles",
        ", ".join(named),
        f"{int(truth.armed.sum())} armed",
        f"{int(truth.airborne.sum())} flying",
        f"battery >= {float(truth.battery_remaining.min()):.0%}",
    ]
    words = [f"page {page + 1}/{pages}", *words] if pages > 1 else words
    return Text("  ".join(words), style="dim")


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}"


def _cut(text: Text, width: int) -> Text:
    text.truncate(width, overflow="ellipsis")
    return text


async def showing(server: Server) -> None:
    """Keep the picture up to date until cancelled; a thread draws it, as heartbeats are due meanwhile."""
    console = Console()
    display, loop = Display(server), asyncio.get_running_loop()
    with Live(console=console, auto_refresh=False) as live:
        try:
            while True:
                picture = display.render(loop.time(), console.width, console.height)
                live.update(picture)
                await asyncio.to_thread(live.refresh)
                await asyncio.sleep(REFRESH_S)
        finally:
            live.update(display.render(loop.time(), console.width, console.height))
