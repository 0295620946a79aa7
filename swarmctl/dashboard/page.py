"""The page: the map in the centre, a card a vehicle, changes of routes, events, and the timeline."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Generic, TypeVar

from nicegui import events, ui

from swarmctl.dashboard.changes import changes
from swarmctl.dashboard.model import EVERYBODY, Timeline
from swarmctl.dashboard.picture import Event, Picture, RouteChange, VehiclePicture
from swarmctl.dashboard.playback import SPEEDS, Playback
from swarmctl.dashboard.risk_map import RiskMap

T = TypeVar("T")

EVERY_S = 0.1
"""interval of the changes that a browser gets [s]"""
CARDS_EVERY = 5
"""the cards and lists follow at every CARDS_EVERY-th change"""
SHOWN_EVENTS = 200
"""most events in the list"""
COLOURS = {"info": "grey", "warning": "orange", "alarm": "red"}
STYLE = """
body { overflow: hidden }
.nicegui-content { padding: 0; gap: 0; height: 100vh; flex-wrap: nowrap }
.risk-map { width: 100%; height: 100% } .risk-map canvas { display: block; touch-action: none; outline: none }
.risk-map canvas:focus-visible { box-shadow: inset 0 0 0 2px #0072b2 }
.card-vehicle { border-left: 6px solid var(--colour); border-radius: 6px; padding: 8px 10px; width: 100% }
.card-vehicle .facts { font-variant-numeric: tabular-nums; font-size: 12px; line-height: 1.5; opacity: .85 }
.is-silent { opacity: .55 }
"""


class Page:
    """The page of one browser. It asks the timeline ten times a second, and sends what has changed."""

    _map: RiskMap

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._playback = Playback(is_live=timeline.is_live)
        self._shown: Picture | None = None
        self._whose = EVERYBODY
        self._exposed: tuple[str, int] | None = None
        self._n_changes = 0
        self._dark = ui.dark_mode(value=None)
        ui.add_css(STYLE)
        with ui.row().classes("w-full items-center gap-3 px-3 py-1 no-wrap"):
            ui.label(timeline.area.swarm).classes("text-lg font-semibold")
            self._source = ui.label().classes("text-sm opacity-75 ellipsis")
            ui.space()
            self._belief = ui.select(
                {EVERYBODY: "all together", **{name: name for name in timeline.area.names}},
                value=EVERYBODY, label="Belief of", on_change=self._choose_belief,
            ).classes("min-w-36").props("dense outlined options-dense")  # fmt: skip
            ui.select(
                {"heat": "heat map of P_s", "paper": "grey, as in the paper"}, value="heat", label="Shading",
                on_change=lambda e: self._map.set_options(shading=e.value),
            ).classes("min-w-40").props("dense outlined options-dense")  # fmt: skip
            ui.checkbox("Hearing", value=True, on_change=lambda e: self._map.set_options(hearing=e.value))
            if timeline.area.hostiles is not None:
                ui.checkbox("True hostiles", on_change=lambda e: self._map.set_options(hostiles=e.value))
            ui.checkbox("Dark", on_change=self._set_dark)
        with ui.row().classes("w-full grow no-wrap gap-0 min-h-0"):
            with ui.element("div").classes("grow h-full min-w-0"):
                self._map = RiskMap().classes("w-full h-full")
            with ui.column().classes("h-full gap-0 min-h-0").style("width: 340px"):
                with ui.tabs().props("dense no-caps").classes("w-full") as tabs:
                    vehicles, routes, told = (ui.tab(n) for n in ("Vehicles", "Route changes", "Events"))
                with ui.tab_panels(tabs, value=vehicles).classes("w-full grow min-h-0 overflow-auto"):
                    with ui.tab_panel(vehicles).classes("p-2 gap-2"):
                        coloured = zip(timeline.area.names, timeline.area.colours, strict=True)
                        self._cards = {name: _Card(name, colour, self._choose) for name, colour in coloured}
                    with ui.tab_panel(routes).classes("p-2"):
                        self._routes = _List(self._route_row)
                    with ui.tab_panel(told).classes("p-2"):
                        self._events = _List(self._event_row)
        with ui.row().classes("w-full items-center gap-3 px-3 py-1 no-wrap"):
            self._play = ui.button(icon="play_arrow", on_click=self._toggle).props("round dense flat")
            self._play.tooltip("Play or pause (space)")
            speeds = {speed: f"{speed:g} ×" for speed in SPEEDS}
            ui.select(speeds, value=1.0, on_change=self._set_speed).props("dense borderless").tooltip("Speed")
            self._slider = ui.slider(min=0.0, max=1.0, step=0.1, value=0.0).classes("grow")
            self._slider.on("update:model-value", self._scrubbed, throttle=0.05)
            self._time = ui.label().classes("tabular-nums whitespace-nowrap")
            if timeline.is_live:
                ui.button("Live", on_click=self._go_live).props("dense flat no-caps")
        ui.keyboard(on_key=self._key)
        self._map.on("ready", self._begin)
        self._map.on("choose", lambda e: self._choose(e.args["vehicle"]))

    def _begin(self) -> None:
        self._map.set_area(self._timeline.area)
        self._shown = self._exposed = None
        ui.timer(EVERY_S, self._refresh)

    def _refresh(self) -> None:
        source = self._timeline.source
        time_s = self._playback.advance(time.monotonic(), source.begin_s, source.end_s)
        picture = self._timeline.at(time_s, (self._whose,))
        self._map.apply(changes(self._shown, picture))
        self._shown = picture
        version = self._version(picture)
        if self._exposed != (self._whose, version):
            self._exposed = self._whose, version
            self._map.set_exposure(self._timeline.exposure(self._whose, time_s))
        self._n_changes += 1
        if self._n_changes % CARDS_EVERY == 1:
            self._show(picture)

    def _version(self, picture: Picture) -> int:
        if self._whose == EVERYBODY:
            return picture.common_version
        return next(v.belief_version for v in picture.vehicles if v.name == self._whose)

    def _show(self, picture: Picture) -> None:
        for vehicle in picture.vehicles:
            self._cards[vehicle.name].show(vehicle)
        self._events.show(picture.events)
        self._routes.show(picture.changes)
        source = picture.source
        age = f"; newest data {source.age_s:.0f} s old" if source.age_s > 2.0 else ""
        self._source.set_text("; ".join(filter(None, (source.kind + age, source.text, *source.lacks))))
        self._slider._props["max"] = max(source.end_s, 0.1)
        self._slider.set_value(picture.time_s)
        self._time.set_text(f"{picture.time_s:.1f} of {source.total_s:.0f} s")
        self._play.props(f"icon={'pause' if self._playback.is_playing else 'play_arrow'}")

    # --- what the person does

    def _choose(self, name: str) -> None:
        self._belief.set_value(name)

    def _choose_belief(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._whose = event.value
        self._map.set_options(whose=event.value)

    def _set_dark(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._dark.value = event.value
        self._map.set_options(dark=event.value)

    def _set_speed(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._playback.speed = event.value

    def _toggle(self) -> None:
        playback, source = self._playback, self._timeline.source
        playback.is_playing = not playback.is_playing
        if playback.is_playing and playback.time_s >= source.end_s:
            playback.seek(source.begin_s)

    def _go_live(self) -> None:
        self._playback.is_live = True

    def _scrubbed(self, event: events.GenericEventArguments) -> None:
        self._playback.seek(float(event.args))

    def _key(self, event: events.KeyEventArguments) -> None:
        if not event.action.keydown:
            return
        source = self._timeline.source
        if event.key == " ":
            self._toggle()
        elif event.key in ("Home", "End"):
            self._playback.seek(source.begin_s if event.key == "Home" else source.end_s)
        elif event.key in (",", "."):
            self._playback.seek(self._playback.time_s + (1.0 if event.key == "." else -1.0))

    def _show_change(self, change: RouteChange) -> None:
        self._playback.seek(change.time_s)
        compared = self._timeline.compared(change.number)
        old = compared.old_now or compared.old
        ghosts = [] if old is None else [{"points": old.points, "colour": "#888888"}]
        self._map.run_method("set_ghosts", ghosts)
        if compared.old_now is not None:
            told = f"new route {_costs(change.new)}; rest of the old route {_costs(compared.old_now)}"
            ui.notify(f"{change.vehicle} at {change.time_s:.0f} s: {told}", position="bottom", timeout=8000)

    def _route_row(self, change: RouteChange) -> None:
        learned = ", ".join(
            f"{item.observer} at {item.observed_s:.0f} s" if item.observed_s is not None else item.observer
            for item in change.because
        )
        row = ui.button(on_click=lambda: self._show_change(change)).props("flat no-caps align=left")
        with row.classes("w-full p-1"), ui.column().classes("gap-0 items-start w-full"):
            ui.label(f"{change.time_s:.0f} s: {change.vehicle}").classes("font-semibold")
            ui.label(f"new: {_costs(change.new)}").classes("text-xs")
            if change.old is not None:
                ui.label(f"old, when it was planned: {_costs(change.old)}").classes("text-xs")
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
            self._note = ui.label().classes("text-xs text-orange-8")
        self._card.on("click", lambda: choose(name))

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
        self._draw, self._n, self._column = draw, -1, ui.column().classes("w-full gap-1")

    def show(self, items: Sequence[T]) -> None:
        if len(items) == self._n:
            return
        self._n = len(items)
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
            f"{known(vehicle.height_m, '{:.0f} m')} high, {known(vehicle.speed_m_s, '{:.1f} m/s')}, "
            f"battery {known(vehicle.battery_percent, '{:.0f} %')}",
            f"{known(share, '{:.0f} %')} of the route, arrives in {known(vehicle.arrives_in_s, '{:.0f} s')}",
            f"knows {vehicle.cells_known} cells and {vehicle.hostiles_known} hostiles; "
            f"{vehicle.replans} replans, {known(vehicle.strikes, '{:.0f}')} strikes",
            f"last word {known(vehicle.age_s, '{:.1f} s ago')}{link}",
        )
    )


def _costs(route: object) -> str:
    length_m, exposure_sum = getattr(route, "length_m", None), getattr(route, "exposure_sum", None)
    if length_m is None or exposure_sum is None:
        return "length and ΣP_s not known"
    return f"{length_m:.0f} m, ΣP_s {exposure_sum:.2f}"


def register(timeline: Timeline) -> None:
    """Serve the page of `timeline` at the root of the application."""

    @ui.page("/", title=f"{timeline.area.swarm} · swarmctl", response_timeout=10.0)
    def root() -> None:
        Page(timeline)
