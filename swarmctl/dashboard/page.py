"""The page: one run, or two side by side, and the timeline of both."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from fastapi import Request
from nicegui import events, ui

from swarmctl.core.messages import MAX_BY
from swarmctl.core.records import replace
from swarmctl.dashboard import style
from swarmctl.dashboard.access import SESSION, Session, Sessions
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.orders_panel import AbortButton, Send
from swarmctl.dashboard.run_view import RunView
from swarmctl.dashboard.tiles import Tiles

SPEEDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""offered speeds of a replay, as multiples of the run's time"""


@dataclass
class Playback:
    """Position, speed and state of a replay; `is_live`: the newest data are shown."""

    time_s: float = 0.0
    speed: float = 1.0
    is_playing: bool = False
    is_live: bool = False
    _looked_s: float | None = None

    def advance(self, now_s: float, end_s: float) -> float:
        """Return the time to show at the wall time `now_s`, from 0 to the end of the source."""
        passed_s = 0.0 if self._looked_s is None else max(now_s - self._looked_s, 0.0)
        self._looked_s = now_s
        if self.is_live:
            self.time_s = end_s
        elif self.is_playing:
            self.time_s += self.speed * passed_s
            if self.time_s >= end_s:
                self.time_s, self.is_playing = end_s, False
        self.time_s = min(max(self.time_s, 0.0), end_s)
        return self.time_s

    def seek(self, time_s: float) -> None:
        self.time_s, self.is_live = time_s, False


HEIGHTS = {"alarm": 12, "warning": 8, "change": 4}
"""height of each kind of mark, so that its colour is not needed [px]"""
WIDTH = 1000
"""number of different places of a mark"""


def marks_of(timelines: Iterable[Timeline], end_s: float) -> str:
    """Return the marks of runs from 0 to `end_s` as SVG; of several marks at one place the highest."""
    at: dict[int, str] = {}

    def add(time_s: float, kind: str) -> None:
        x = 2 * round(0.5 * WIDTH * min(time_s / max(end_s, 0.1), 1.0))
        if HEIGHTS[kind] > HEIGHTS.get(at.get(x, ""), 0):
            at[x] = kind

    for timeline in timelines:
        for change in timeline.changes.items:
            add(change.time_s, "change")
        for event in timeline.events.items:
            if event.severity != "info":
                add(event.time_s, event.severity)
    marks = (
        f'<rect class="{kind}" x="{x - 1}" y="{HEIGHTS["alarm"] - HEIGHTS[kind]}" width="2" '
        f'height="{HEIGHTS[kind]}"/>'
        for x, kind in at.items()
    )
    label = "Alarms (high), warnings, and changes of routes (low)"
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHTS["alarm"]}" preserveAspectRatio="none" role="img" '
        f'aria-label="{label}">{"".join(marks)}</svg>'
    )


EVERY_S = 0.1
"""interval of the changes that a browser gets [s]"""
CARDS_EVERY = 5
"""the cards and lists follow at every CARDS_EVERY-th change"""
USED_BY = ("div", "a")
"""elements of controls: with the focus they use the space bar, Home and End themselves"""


class Page:
    """The page of one browser: one run, or two side by side on one time.

    It asks the timelines ten times a second, and sends what has changed.
    """

    def __init__(
        self,
        runs: Mapping[str, Timeline],
        back: tuple[str, str] | None = None,
        heading: str = "",
        send: Send | None = None,
        tiles: Tiles | None = None,
        people: Callable[[], str] = str,
        *,
        is_viewer: bool = False,
    ) -> None:
        """`runs`: the timelines by title; `back`: address and text of a link to the page before.

        `send` sends commands to the swarm of a single timeline; None: it is only watched. `people`: all who
        have the page open, in words.

        The default of the heading is the name of the swarm.
        """
        self._timelines = tuple(runs.values())
        self._playback = Playback(is_live=self._is_flight)
        self._n_changes = 0
        seek = self._playback.seek
        self._views = [
            RunView(timeline, title, seek, send, tiles, is_viewer=is_viewer)
            for title, timeline in runs.items()
        ]
        self._people = people
        self._dark = ui.dark_mode(value=None)
        is_single = len(self._views) == 1
        ui.add_css(style.COMMON + style.RUNS)
        with ui.row().classes("head w-full items-center gap-3 px-3 py-1"):
            if back is not None:
                ui.link(back[1], back[0])
            names = dict.fromkeys(timeline.area.swarm for timeline in self._timelines)
            ui.label(heading or " and ".join(names)).classes("text-lg font-semibold ellipsis")
            if is_single:
                self._views[0].add_source()
                self._views[0].add_belief()
            else:
                ui.space()
            self._others = ui.label().classes("people text-sm").props("aria-live=polite")
            ui.select(
                {"heat": "heat map", "paper": "grey (paper)"}, value="heat", label="Shading",
                on_change=lambda e: self._set_options(shading=e.value),
            ).classes("min-w-36").props("dense outlined options-dense")  # fmt: skip
            ui.checkbox("Hearing", value=True, on_change=lambda e: self._set_options(hearing=e.value))
            if any(timeline.area.hostiles is not None for timeline in self._timelines):
                ui.checkbox("True hostiles", on_change=lambda e: self._set_options(hostiles=e.value))
            ui.checkbox("Dark", on_change=self._set_dark)
            if send is not None:
                AbortButton(send)
        with ui.element("div").classes("runs").classes("is-single" if is_single else "is-double"):
            for view in self._views:
                view.add(has_head=not is_single)
        with ui.row().classes("w-full items-center gap-3 px-3 py-1 no-wrap"):
            self._play = ui.button(icon="play_arrow", on_click=self._toggle).props("round dense flat")
            self._play.props('aria-label="Play or pause"').tooltip("Play or pause (space)")
            speeds = {speed: f"{speed:g} ×" for speed in SPEEDS}
            speed = ui.select(speeds, value=1.0, label="Speed", on_change=self._set_speed)
            speed.classes("speed").props("dense borderless options-dense")
            with ui.element("div").classes("time"):
                self._marks = ui.html("", sanitize=False)
                self._slider = ui.slider(min=0.0, max=1.0, step=0.1, value=0.0)
            self._slider.props("aria-label=Time").on("update:model-value", self._scrubbed, throttle=0.05)
            self._time = ui.label().classes("tabular-nums whitespace-nowrap")
            if self._is_flight:
                ui.button("Live", on_click=self._go_live).props("dense flat no-caps")
        ui.keyboard(on_key=self._step_key)
        ignored: Any = ["input", "select", "button", "textarea", *USED_BY]
        ui.keyboard(on_key=self._key, ignore=ignored)
        ui.timer(EVERY_S, self._refresh)

    @property
    def _is_flight(self) -> bool:
        # A page that is opened after the flight shows its end and its alarms.
        return any(timeline.is_flight for timeline in self._timelines)

    @property
    def _end_s(self) -> float:
        return max(timeline.source.end_s for timeline in self._timelines)

    def _refresh(self) -> None:
        time_s = self._playback.advance(time.monotonic(), self._end_s)
        for view in self._views:
            view.refresh(time_s)
        # One scale of P_s for all maps: equal shades are equal values.
        # It reaches to P_s of a cell with a single hostile at least, so a prior alone is light.
        exposures = [view.exposure for view in self._views if view.exposure is not None]
        limits = [timeline.scenario.strength.direct for timeline in self._timelines]
        largest = max([*limits, *(float(p_s.max(initial=0.0)) for p_s in exposures)])
        for view in self._views:
            view.shade(largest)
        self._n_changes += 1
        if self._n_changes % CARDS_EVERY == 1:
            self._show(time_s)

    def _show(self, time_s: float) -> None:
        for view in self._views:
            view.show(time_s)
        self._others.set_text(self._people())
        total_s = max(timeline.source.total_s for timeline in self._timelines)
        self._slider._props["max"] = max(self._end_s, 0.1)
        self._slider.set_value(time_s)
        self._marks.set_content(marks_of(self._timelines, self._end_s))
        self._time.set_text(f"{time_s:.1f} of {total_s:.0f} s")
        self._play.props(f"icon={'pause' if self._playback.is_playing else 'play_arrow'}")

    # --- what the person does

    def _set_options(self, **options: Any) -> None:
        for view in self._views:
            view.set_options(**options)

    def _set_dark(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._dark.value = event.value
        self._set_options(dark=event.value)

    def _set_speed(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._playback.speed = event.value

    def _toggle(self) -> None:
        playback = self._playback
        playback.is_playing = not playback.is_playing
        if playback.is_playing and playback.time_s >= self._end_s:
            playback.seek(0.0)

    def _go_live(self) -> None:
        self._playback.is_live = True

    def _scrubbed(self, event: events.GenericEventArguments) -> None:
        self._playback.seek(float(event.args))

    def _key(self, event: events.KeyEventArguments) -> None:
        if not event.action.keydown:
            return
        if event.key == " ":
            self._toggle()
        elif event.key in ("Home", "End"):
            self._playback.seek(0.0 if event.key == "Home" else self._end_s)

    def _step_key(self, event: events.KeyEventArguments) -> None:
        if event.action.keydown and event.key in (",", "."):
            self._playback.seek(self._playback.time_s + (1.0 if event.key == "." else -1.0))


def register(
    runs: Mapping[str, Timeline], sessions: Sessions, send: Send | None = None, tiles: Tiles | None = None
) -> None:
    """Serve the page of runs, by title, at the root of the application."""

    @ui.page("/", title=f"{' and '.join(runs)} · swarmctl", response_timeout=10.0)
    def root(request: Request) -> None:
        serve_run(request, runs, sessions, send, tiles)


def serve_run(
    request: Request,
    runs: Mapping[str, Timeline],
    sessions: Sessions,
    send: Send | None,
    tiles: Tiles | None,
    back: tuple[str, str] | None = None,
) -> None:
    """Make the page of runs for the person of a request; the arguments are those of `Page`."""
    session = request.scope[SESSION]
    present(session)
    Page(
        runs,
        back,
        send=_sender(session, send),
        tiles=tiles,
        people=lambda: _people(session, sessions),
        is_viewer=session.role == "viewer",
    )


def present(session: Session) -> None:
    """Count the page that is being made among the open pages of its session."""
    client = ui.context.client

    def connected() -> None:
        session.n_pages += 1

    def disconnected() -> None:
        session.n_pages -= 1

    client.on_connect(connected)
    client.on_disconnect(disconnected)


def _sender(session: Session, send: Send | None) -> Send | None:
    """Return a sender that names the person in each command; None for a viewer."""
    if send is None or session.role != "operator":
        return None
    by = f"dashboard: {session.name}"[:MAX_BY]
    return lambda request: send(replace(request, by=by))


def _people(own: Session, sessions: Sessions) -> str:
    """Return all who have the page open, if there are others."""
    others = [session for session in sessions.present if session is not own]
    return f"you: {own.name}; also here: {', '.join(other.name for other in others)}" if others else ""
