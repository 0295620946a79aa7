"""The set-up: a configuration on the map, its first routes, its problems, its save, and its flight."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from fastapi import Request
from nicegui import events, run, ui

from swarmctl.config.problems import ConfigError
from swarmctl.config.scenario import Scenario, build
from swarmctl.config.yaml_lines import KeyPath
from swarmctl.core.exposure import exposure
from swarmctl.dashboard import picture_parts, style
from swarmctl.dashboard.access import SESSION, Sessions
from swarmctl.dashboard.draft import Draft
from swarmctl.dashboard.flights import Flights, NotStarted
from swarmctl.dashboard.orders_panel import confirmed, tell
from swarmctl.dashboard.page import present, serve_run
from swarmctl.dashboard.risk_map import RiskMap
from swarmctl.dashboard.setup_edits import (
    SIMULATED,
    TOOLS,
    FirstRouteShown,
    as_changes,
    edits_of_click,
    first_routes,
)
from swarmctl.dashboard.tiles import Tiles

FindProblems = Callable[[Draft, Scenario], list[str]]
"""what `swarmctl check` finds in a valid configuration on this machine"""

MARGIN_PX = 90
"""margin around the area, for starts outside it"""
FIELDS: dict[KeyPath, tuple[str, int | None]] = {
    ("area", "rows"): ("Rows", 1),
    ("area", "cols"): ("Columns", 1),
    ("area", "cell_size_m"): ("Side of a cell [m]", None),
    ("simulate", "count"): ("Simulated vehicles", 1),
    ("threats", "count"): ("Hostiles", 1),
    ("planner", "w"): ("w: 0 short, 1 safe", None),
    ("seed",): ("Seed", 1),
}
"""label and step of each number that can be typed"""


class SetupPage:
    """The set-up of one browser."""

    _map: RiskMap

    def __init__(
        self, path: Path, find_problems: FindProblems, flights: Flights, tiles: Tiles | None
    ) -> None:
        self._tiles, self._flights = tiles, flights
        self._draft = Draft.open(path)
        self._find_problems = find_problems
        self._tool, self._whose, self._number = "no_fly", SIMULATED, 0
        self._fields: dict[KeyPath, ui.number] = {}
        ui.add_css(style.COMMON + style.RUNS)
        self._dark = ui.dark_mode(value=None)
        with ui.row().classes("head w-full items-center gap-3 px-3 py-1"):
            ui.label(f"Set-up of {path}").classes("text-lg font-semibold ellipsis")
            ui.space()
            if flights.newest:
                ui.link(f"Flight {flights.newest}", address(flights.newest))
            ui.toggle(TOOLS, value=self._tool, on_change=self._set_tool).props("dense no-caps")
            ui.checkbox("Dark", on_change=self._set_dark)
        with ui.element("div").classes("runs"), ui.element("div").classes("run"):
            with ui.element("div").classes("run-map"):
                self._map = RiskMap().classes("w-full h-full")
            with ui.column().classes("run-side gap-2 p-2 overflow-auto"):
                self._side()
        self._map.on("ready", self._begin)
        self._map.on("place", self._placed)

    def _side(self) -> None:
        names = {SIMULATED: "simulated vehicles"} if self._draft.value(("simulate",)) else {}
        names |= {v["name"]: v["name"] for v in self._draft.value(("vehicles",), ()) if "name" in v}
        self._whose = next(iter(names), SIMULATED)
        ui.select(names, value=self._whose, label="Start and goal of", on_change=self._choose).classes(
            "w-full"
        ).props("dense outlined options-dense")
        with ui.element("div").classes("fields"):
            for path, (label, step) in FIELDS.items():
                value = self._draft.value(path)
                if isinstance(value, (int, float)):
                    field = ui.number(label, value=value, step=step, on_change=partial(self._typed, path))
                    self._fields[path] = field.props("dense outlined debounce=400")
        with ui.row().classes("w-full gap-2"):
            ui.button("Save", on_click=self._save).props("dense no-caps")
            ui.button("Save and fly", on_click=self._fly).props("dense no-caps outline")
            ui.button("Undo", on_click=self._undo).props("dense no-caps flat")
        self._state = ui.label().classes("text-sm w-full").props("role=status aria-live=polite")
        self._saved = ui.label().classes("saved text-sm w-full").props("aria-live=polite")
        self._problems = ui.column().classes("problems w-full gap-1 text-xs")
        self._routes = ui.column().classes("first-routes w-full gap-1 text-xs")

    async def _begin(self) -> None:
        tiles = {} if self._tiles is None else {"tiles": self._tiles.option()}
        self._map.set_options(places=True, margin_px=MARGIN_PX, hostiles=True, **tiles)
        await self._show()

    # --- what the person does

    def _set_tool(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._tool = event.value

    def _set_dark(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._dark.value = event.value
        self._map.set_options(dark=event.value)

    def _choose(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._whose = event.value

    async def _placed(self, event: events.GenericEventArguments) -> None:
        # The map may still show an earlier text: a click always edits the newest one.
        config = self._draft.schema_config()
        if config is None:
            ui.notify("correct the problems first; `Undo` takes the last change back", type="warning")
            return
        at = float(event.args["east"]), float(event.args["north"])
        try:
            edits = edits_of_click(config, self._tool, self._whose, at)
        except ValueError as error:
            ui.notify(str(error), type="warning")
            return
        await self._edit(edits)

    async def _typed(self, path: KeyPath, event: events.ValueChangeEventArguments[Any]) -> None:
        if event.value is None or event.value == self._draft.value(path):
            return
        value = int(event.value) if float(event.value).is_integer() else float(event.value)
        await self._edit({path: value})

    async def _edit(self, edits: dict[KeyPath, Any]) -> None:
        try:
            self._draft.edit(edits)
        except ValueError as error:
            ui.notify(str(error), type="warning")
            return
        await self._show()

    async def _undo(self) -> None:
        if self._draft.undo():
            for path, field in self._fields.items():
                field.set_value(self._draft.value(path))
            await self._show()

    def _save(self) -> bool:
        """Save, and return whether the file has the draft now."""
        try:
            self._draft.save()
        except ConfigError as error:
            self._saved.set_text("not saved")
            ui.notify("\n".join(error.lines), type="negative", multi_line=True)
            return False
        self._saved.set_text(f"saved in {self._draft.path}")
        return True

    async def _fly(self) -> None:
        """Save, start a flight of the file, and go to its page."""
        config, _ = self._draft.checked()
        if not self._save() or config is None:
            return
        scenario = build(config)
        real = [spec.name for spec in scenario.swarm if not spec.simulated]
        if real and not await confirmed(f"Fly {config.name} now?", "Fly", real):
            return
        self._saved.set_text("the flight begins …")
        try:
            number = await self._flights.start(self._draft.path, scenario, real)
        except NotStarted as error:
            self._saved.set_text("no flight has begun")
            tell([str(error)], is_good=False)
            return
        ui.navigate.to(address(number))

    # --- what it shows

    async def _show(self) -> None:
        self._number += 1
        number = self._number
        self._saved.set_text("")
        self._state.set_text("computing the first routes …")
        computed = await run.io_bound(_computed, self._draft.copy(), self._find_problems)
        if computed is None:
            return  # the server stops
        scenario, problems, routes = computed
        if number != self._number:
            return  # a newer change is on its way
        self._state.set_text("no problems" if not problems else f"{len(problems)} problems")
        self._problems.clear()
        with self._problems:
            for line in problems:
                ui.label(line).classes("text-red-8 break-words")
        if scenario is not None:
            self._draw(scenario, routes)

    def _draw(self, scenario: Scenario, routes: list[FirstRouteShown]) -> None:
        area = picture_parts.area(scenario)
        self._map.set_area(area)
        p_s = exposure(scenario.prior.occupancy(), scenario.strength)
        self._map.set_exposure(p_s, max(float(p_s.max(initial=0.0)), scenario.strength.direct))
        self._map.apply(dict(as_changes(routes)))
        self._routes.clear()
        colours = dict(zip(area.names, area.colours, strict=True))
        with self._routes:
            for route in routes:
                with ui.row().classes("gap-2 no-wrap items-center"):
                    ui.element("div").style(f"width: 12px; height: 12px; background: {colours[route.name]}")
                    ui.label(f"{route.name}: {route.route or 'no track of the route can be flown'}")


def _computed(
    draft: Draft, find_problems: FindProblems
) -> tuple[Scenario | None, list[str], list[FirstRouteShown]]:
    config, problems = draft.checked()
    if config is None:
        return None, problems, []
    scenario = build(config)
    return scenario, find_problems(draft, scenario), first_routes(scenario)


def address(number: int) -> str:
    """Return the address of a flight that the set-up has started."""
    return f"/flight/{number}"


def register(
    path: Path, sessions: Sessions, find_problems: FindProblems, flights: Flights, tiles: Tiles | None = None
) -> None:
    """Serve the set-up of a configuration at the root of the application, and its flights below."""

    @ui.page("/", title=f"{path.name} · swarmctl", response_timeout=10.0)
    def root(request: Request) -> None:
        session = request.scope[SESSION]
        present(session)
        if session.role == "operator":
            SetupPage(path, find_problems, flights, tiles)
            return
        ui.label("The set-up is for operators.")
        if flights.newest:
            ui.link(f"Flight {flights.newest}", address(flights.newest))

    @ui.page("/flight/{number}", title=f"{path.name} · swarmctl", response_timeout=10.0)
    def flight(request: Request, number: int) -> None:
        try:
            started = flights[number]
        except IndexError as error:
            ui.label(str(error))
            return
        run = {str(started.process.folder): started.timeline}
        serve_run(request, run, sessions, started.send, tiles, back=("/", "Set-up"))
