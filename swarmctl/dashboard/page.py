"""The page: one run, or two side by side, and the timeline of both."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from fastapi import Request
from nicegui import events, ui

from swarmctl.core.messages import MAX_BY
from swarmctl.dashboard.access import SESSION, Session, Sessions
from swarmctl.dashboard.model import Timeline
from swarmctl.dashboard.orders_panel import AbortButton, Send
from swarmctl.dashboard.playback import SPEEDS, Playback
from swarmctl.dashboard.run_view import RunView
from swarmctl.dashboard.tiles import Tiles

EVERY_S = 0.1
"""interval of the changes that a browser gets [s]"""
CARDS_EVERY = 5
"""the cards and lists follow at every CARDS_EVERY-th change"""
STYLE = """
body { overflow: hidden }
.nicegui-content { padding: 0; gap: 0; height: 100vh; flex-wrap: nowrap }
.risk-map { width: 100%; height: 100%; position: relative }
.risk-map canvas { display: block; touch-action: none; outline: none }
.risk-map canvas:focus-visible { box-shadow: inset 0 0 0 2px #0072b2 }
.unheard { position: absolute; top: 8px; left: 8px; right: 8px; padding: 6px 12px; border-radius: 6px }
.unheard { background: #a00000; color: #fff; font-weight: 600; text-align: center }
.card-vehicle { border-left: 6px solid var(--colour); border-radius: 6px; padding: 8px 10px; width: 100% }
.card-vehicle .facts { font-variant-numeric: tabular-nums; font-size: 12px; line-height: 1.5; opacity: .85 }
.alarms { background: rgba(200, 0, 0, .1); border-left: 6px solid #c00; flex: none }
.is-silent { opacity: .55 }
.runs { width: 100%; flex: 1 1 0; min-height: 0; display: grid }
.runs { grid-auto-columns: minmax(0, 1fr); grid-auto-flow: column }
.run { display: flex; min-width: 0; min-height: 0 } .run-map { flex: 1 1 0; min-width: 0; min-height: 0 }
.run-side { flex: 0 0 360px; width: 360px; min-width: 0; min-height: 0; flex-wrap: nowrap }
.is-double .run { flex-direction: column; border-left: 1px solid rgba(128, 128, 128, .4) }
.run-head { flex: none } .source { flex: 1 1 8em; min-width: 0 }
.is-double .run-side { flex: 0 0 34%; width: 100% }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(300px, 1fr)); align-content: start }
.cards > .orders { grid-column: 1 / -1 }
@media (max-width: 1000px) { .head { gap: 4px } .head .q-field { min-width: 0; width: 8.5rem } }
@media (max-width: 1000px) { .head .q-checkbox__label { font-size: 12px } }
@media (max-width: 1000px) { .run { flex-direction: column } .run-side { flex: 0 0 34%; width: 100% } }
"""


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
        self._playback = Playback(is_live=self._is_live)
        self._n_changes = 0
        seek = self._playback.seek
        self._views = [
            RunView(timeline, title, seek, send, tiles, is_viewer=is_viewer)
            for title, timeline in runs.items()
        ]
        self._people = people
        self._dark = ui.dark_mode(value=None)
        is_single = len(self._views) == 1
        ui.add_css(STYLE)
        with ui.row().classes("head w-full items-center gap-3 px-3 py-1"):
            if back is not None:
                ui.link(back[1], back[0])
            names = dict.fromkeys(timeline.area.swarm for timeline in self._timelines)
            ui.label(heading or " and ".join(names)).classes("text-lg font-semibold")
            if is_single:
                self._views[0].add_source()
                self._views[0].add_belief()
            else:
                ui.space()
            self._others = ui.label().classes("people text-sm").props("aria-live=polite")
            ui.select(
                {"heat": "heat map of P_s", "paper": "grey, as in the paper"}, value="heat", label="Shading",
                on_change=lambda e: self._set_options(shading=e.value),
            ).classes("min-w-40").props("dense outlined options-dense")  # fmt: skip
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
            speed = ui.select(speeds, value=1.0, on_change=self._set_speed).props("dense borderless")
            speed.props("aria-label=Speed").tooltip("Speed")
            self._slider = ui.slider(min=0.0, max=1.0, step=0.1, value=0.0).classes("grow")
            self._slider.props("aria-label=Time").on("update:model-value", self._scrubbed, throttle=0.05)
            self._time = ui.label().classes("tabular-nums whitespace-nowrap")
            if self._is_live:
                ui.button("Live", on_click=self._go_live).props("dense flat no-caps")
        ui.keyboard(on_key=self._key)
        ui.timer(EVERY_S, self._refresh)

    @property
    def _is_live(self) -> bool:
        return any(timeline.is_live for timeline in self._timelines)

    @property
    def _end_s(self) -> float:
        return max(timeline.source.end_s for timeline in self._timelines)

    def _refresh(self) -> None:
        time_s = self._playback.advance(time.monotonic(), 0.0, self._end_s)
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
        elif event.key in (",", "."):
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
    return lambda request: send(msgspec.structs.replace(request, by=by))


def _people(own: Session, sessions: Sessions) -> str:
    """Return all who have the page open, if there are others."""
    others = [session for session in sessions.present if session is not own]
    return f"you: {own.name}; also here: {', '.join(other.name for other in others)}" if others else ""
