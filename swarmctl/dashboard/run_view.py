"""One run on the page: its map, a card a vehicle, changes of routes, and events."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any, Generic, TypeVar

import numpy as np
from nicegui import events, ui
from numpy.typing import NDArray

from swarmctl.dashboard import picture_parts
from swarmctl.dashboard.changes import changes
from swarmctl.dashboard.model import EVERYBODY, Timeline
from swarmctl.dashboard.orders_panel import OrdersPanel, Send
from swarmctl.dashboard.picture import Event, Picture, RouteChange, Severity, VehiclePicture
from swarmctl.dashboard.risk_map import RiskMap
from swarmctl.dashboard.tiles import Tiles
from swarmctl.dashboard.what_if_panel import Ghosts, WhatIfPanel

T = TypeVar("T")

ENDED_BY_S = 0.1
"""time after the end of a run from which on its end is told [s]"""
SHOWN_EVENTS = 200
"""most events in the list"""
SEVERITIES: tuple[Severity, ...] = ("info", "warning", "alarm")
COLOURS = {"info": "grey", "warning": "orange", "alarm": "red"}


class RunView:
    """The map of one run, with its cards and lists.

    `seek` moves the page to another time.
    """

    _map: RiskMap

    def __init__(
        self,
        timeline: Timeline,
        title: str,
        seek: Callable[[float], None],
        send: Send | None = None,
        tiles: Tiles | None = None,
        *,
        is_viewer: bool = False,
    ) -> None:
        """`send` sends commands to the swarm; None: it is only watched."""
        self.timeline = timeline
        self._tiles, self._is_viewer = tiles, is_viewer
        self._send = send
        self._orders: OrdersPanel | None = None
        self.exposure: NDArray[np.float64] | None = None
        """P_s by the chosen belief at the time shown"""
        self._title = title
        self._seek = seek
        self._shown: Picture | None = None
        self._whose = EVERYBODY
        self._exposed: object = None
        """key of the exposure"""
        self._largest_sent: float | None = None
        self._is_ready = False
        self._severities: tuple[Severity, ...] = SEVERITIES

    def add_belief(self) -> None:
        """Add the choice of the belief."""
        self._belief = ui.select(
            {EVERYBODY: "all together", **{name: name for name in self.timeline.area.names}},
            value=EVERYBODY, label="Belief of", on_change=self._choose_belief,
        ).classes("min-w-36").props("dense outlined options-dense")  # fmt: skip

    def add_source(self) -> None:
        """Add the line with the state of the source."""
        self._source = ui.label().classes("source text-sm opacity-75 ellipsis")

    def add(self, *, has_head: bool) -> None:
        """Add the map, the cards and the lists; `has_head`: below a line of title, source and belief."""
        timeline = self.timeline
        with ui.element("section").classes("run").props(f'aria-label="{escape(self._title)}"'):
            if has_head:
                with ui.row().classes("run-head items-center gap-2 px-2 no-wrap"):
                    ui.label(self._title).classes("run-title font-semibold ellipsis").tooltip(self._title)
                    self.add_source()
                    self.add_belief()
            with ui.element("div").classes("run-map"):
                self._map = RiskMap().classes("w-full h-full")
            with ui.column().classes("run-side gap-0"):
                self._alarms = None
                if timeline.is_flight:
                    self._alarms = AlarmList(timeline, may_acknowledge=not self._is_viewer)
                with ui.tabs().props("dense no-caps").classes("w-full") as tabs:
                    names = ("Vehicles", "Route changes", "Events", "What if")
                    vehicles, routes, told, what_if = (ui.tab(name) for name in names)
                with ui.tab_panels(tabs, value=vehicles).classes("w-full grow min-h-0 overflow-auto"):
                    with ui.tab_panel(vehicles).classes("cards p-2 gap-2"):
                        if self._send is not None:
                            self._orders = OrdersPanel(timeline, self._send)
                        coloured = zip(timeline.area.names, timeline.area.colours, strict=True)
                        self._cards = {name: _Card(name, colour, self._choose) for name, colour in coloured}
                    with ui.tab_panel(routes).classes("p-2"):
                        self._routes = _List(self._route_row)
                    with ui.tab_panel(told).classes("p-2"):
                        self._add_severities()
                        self._events = _List(self._event_row)
                    with ui.tab_panel(what_if).classes("p-2"):
                        self._what_if = WhatIfPanel(timeline, self._draw_ghosts, self._send)
        self._map.on("ready", self._begin)
        self._map.on("choose", lambda e: self._choose(e.args["vehicle"]))

    def _begin(self) -> None:
        if self._tiles is not None:
            self._map.set_options(tiles=self._tiles.option())
        self._map.set_area(self.timeline.area)
        self._shown = self._exposed = self._largest_sent = None
        self._is_ready = True

    def refresh(self, time_s: float) -> None:
        """Send what has changed at a time; beyond the end of this run its end is shown."""
        if not self._is_ready:
            return
        picture = self.timeline.at(time_s, self._whose)
        self._map.apply(changes(self._shown, picture))
        self._shown = picture
        key = self.timeline.exposure_key(self._whose, time_s)
        if self._exposed != key:
            self._exposed, self._largest_sent = key, None
            self.exposure = self.timeline.exposure(self._whose, time_s)

    def shade(self, largest: float) -> None:
        """Send the exposure if it, or the largest P_s of the scale, has changed."""
        if self.exposure is not None and self._is_ready and self._largest_sent != largest:
            self._largest_sent = largest
            self._map.set_exposure(self.exposure, largest)

    def set_options(self, **options: Any) -> None:
        self._map.set_options(**options)

    def show(self, time_s: float) -> None:
        """Show the picture that was sent last in the cards and lists."""
        picture = self._shown
        if picture is None:
            return
        for vehicle in picture.vehicles:
            self._cards[vehicle.name].show(vehicle)
        self._what_if.at(picture.time_s)
        if self._alarms is not None:
            self._alarms.show(picture)
        self._events.show([event for event in picture.events if event.severity in self._severities])
        self._routes.show(picture.changes)
        source = picture.source
        has_data = self.timeline.version > 0
        age = f"newest data {source.age_s:.0f} s old" if has_data else f"no data for {source.age_s:.0f} s"
        age = f"; {age}" if source.age_s > 2.0 else ""
        ended = f"ended at {source.end_s:.0f} s" if time_s > source.end_s + ENDED_BY_S else ""
        self._source.set_text("; ".join(filter(None, (source.kind + age, ended, source.text, *source.lacks))))

    # --- what the person does

    def _choose(self, name: str) -> None:
        self._belief.set_value(name)

    def _choose_belief(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._whose = event.value
        self._what_if.choose(event.value)
        if self._orders is not None:
            self._orders.choose(event.value)

    def _draw_ghosts(self, ghosts: Ghosts) -> None:
        if self._is_ready:
            self._map.run_method("set_ghosts", ghosts)

    def _add_severities(self) -> None:
        """Add the choice of the severities in the list of events."""
        choices = {SEVERITIES: "all", SEVERITIES[1:]: "warnings and alarms", SEVERITIES[2:]: "alarms"}
        ui.select(choices, value=SEVERITIES, label="Events", on_change=self._choose_severities).props(
            "dense outlined options-dense"
        ).classes("w-full")

    def _choose_severities(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._severities = event.value

    def _show_change(self, change: RouteChange) -> None:
        self._seek(change.time_s)
        rest = picture_parts.rest_of_old(self.timeline, change)
        old = rest or change.old
        ghosts = [] if old is None else [{"points": old.points, "colour": "#888888"}]
        self._draw_ghosts(ghosts)
        if rest is not None:
            told = f"new route {change.new}; rest of the old route {rest}"
            ui.notify(f"{change.vehicle} at {change.time_s:.0f} s: {told}", position="bottom", timeout=8000)

    def _route_row(self, change: RouteChange) -> None:
        learned = ", ".join(
            f"{item.observer} at {item.observed_s:.0f} s" if item.observed_s is not None else item.observer
            for item in change.because
        )
        row = ui.button(on_click=lambda: self._show_change(change)).props("flat no-caps align=left")
        with row.classes("w-full p-1"), ui.column().classes("gap-0 items-start w-full"):
            ui.label(f"{change.time_s:.0f} s: {change.vehicle}").classes("font-semibold")
            ui.label(f"new: {change.new}").classes("text-xs")
            if change.old is not None:
                ui.label(f"old, when it was planned: {change.old}").classes("text-xs")
            if learned:
                ui.label(f"learned from {learned}").classes("text-xs opacity-75 text-left")

    def _event_row(self, event: Event) -> None:
        with ui.row().classes("w-full gap-2 no-wrap items-start text-xs"):
            ui.badge(f"{event.time_s:.0f} s", color=COLOURS[event.severity]).classes("shrink-0")
            ui.label(f"{event.vehicle}: {event.text}" if event.vehicle else event.text)


class _Card:
    """The card of one vehicle."""

    def __init__(self, name: str, colour: str, choose: Callable[[str], None]) -> None:
        self._texts: tuple[str, ...] = ()
        self._card = ui.card().classes("card-vehicle gap-0 cursor-pointer").style(f"--colour: {colour}")
        with self._card:
            with ui.row().classes("w-full items-baseline no-wrap"):
                ui.label(name).classes("font-semibold")
                ui.space()
                self._state = ui.label().classes("text-sm")
            self._facts = ui.label().classes("facts whitespace-pre-line")
            self._note = ui.label().classes("note text-xs")
        self._card.props(f'tabindex=0 role=button aria-label="Belief of {escape(name)}"')
        for event in ("click", "keydown.enter"):
            self._card.on(event, lambda: choose(name))

    def show(self, vehicle: VehiclePicture) -> None:
        state = f"{vehicle.phase} · {vehicle.mode}".strip(" ·")
        texts = state, _facts(vehicle), vehicle.waiting or vehicle.note
        if texts == self._texts:
            return
        self._texts = texts
        for label, text in zip((self._state, self._facts, self._note), texts, strict=True):
            label.set_text(text)
        if vehicle.is_silent:
            self._card.classes(add="is-silent")
        else:
            self._card.classes(remove="is-silent")


class _List(Generic[T]):
    """A list that shows the newest item first, and is drawn again when it has changed."""

    def __init__(self, draw: Callable[[T], None]) -> None:
        self._draw, self._column = draw, ui.column().classes("w-full gap-1")
        self._ends: tuple[object, ...] | None = None

    def show(self, items: Sequence[T]) -> None:
        ends = (len(items), *((items[0], items[-1]) if items else ()))
        if ends == self._ends:
            return
        self._ends = ends
        self._column.clear()
        with self._column:
            for item in list(items)[-SHOWN_EVENTS:][::-1]:
                self._draw(item)


def _facts(vehicle: VehiclePicture) -> str:
    def known(value: float | None, pattern: str) -> str:
        return pattern.format(value) if value is not None else "–"

    share = None if vehicle.progress is None else 100.0 * vehicle.progress
    link = f", link {vehicle.link}" if vehicle.link else ""
    return "\n".join(
        (
            f"{known(vehicle.height_m, '{:z.0f} m')} high, {known(vehicle.speed_m_s, '{:.1f} m/s')}, "
            f"battery {known(vehicle.battery_percent, '{:.0f} %')}",
            f"{known(share, '{:.0f} %')} of the route, arrives in {known(vehicle.arrives_in_s, '{:.0f} s')}",
            f"known cells: {vehicle.cells_known}, known hostiles: {vehicle.hostiles_known}",
            f"changes of route: {vehicle.replans}, strikes: {known(vehicle.strikes, '{:.0f}')}",
            f"last word {known(vehicle.age_s, '{:.1f} s ago')}{link}",
        )
    )


SHOWN = 3
"""most alarms shown at once, the newest first"""


class AlarmList:
    """The alarms that nobody has acknowledged yet; an acknowledgement counts for all browsers."""

    def __init__(self, timeline: Timeline, *, may_acknowledge: bool) -> None:
        self._timeline = timeline
        self._may_acknowledge = may_acknowledge
        self._shown: tuple[int, ...] | None = None
        self._box = ui.column().classes("alarms w-full").props('role=alert aria-label="Alarms"')
        self._box.set_visibility(False)

    def show(self, picture: Picture) -> None:
        """Show the open alarms of a picture, if they have changed."""
        acknowledged = self._timeline.acknowledged
        alarms = [e for e in picture.events if e.severity == "alarm" and e.number not in acknowledged]
        numbers = tuple(alarm.number for alarm in alarms)
        if numbers == self._shown:
            return
        self._shown = numbers
        self._box.clear()
        self._box.set_visibility(bool(alarms))
        with self._box:
            for alarm in alarms[-SHOWN:][::-1]:
                self._row(alarm)
            if len(alarms) > 1 and self._may_acknowledge:
                more = f"{len(alarms)} alarms"
                ui.button(f"Acknowledge all {more}", on_click=lambda: self._acknowledge(numbers)).props(
                    "dense flat no-caps"
                )

    def _row(self, alarm: Event) -> None:
        with ui.row().classes("w-full no-wrap items-center text-xs"):
            ui.badge(f"{alarm.time_s:.0f} s", color="red").classes("shrink-0")
            ui.label(f"{alarm.vehicle}: {alarm.text}" if alarm.vehicle else alarm.text).classes("grow")
            if not self._may_acknowledge:
                return
            button = ui.button(icon="done", on_click=lambda: self._acknowledge((alarm.number,)))
            button.props('dense flat round size=sm aria-label="Acknowledge"').tooltip("Acknowledge")

    def _acknowledge(self, numbers: tuple[int, ...]) -> None:
        self._timeline.acknowledged.update(numbers)
