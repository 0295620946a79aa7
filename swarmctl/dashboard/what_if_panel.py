"""The sliders of w and the firing strengths, with the routes that would be flown, and a Pareto front."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from nicegui import events, run, ui

from swarmctl.core.messages import CommunicationRange, SetWeights
from swarmctl.core.threat import FiringStrength
from swarmctl.dashboard.model import EVERYBODY, Timeline
from swarmctl.dashboard.orders_panel import Send, send_and_tell, tell
from swarmctl.dashboard.picture import ShownRoute
from swarmctl.dashboard.what_if import (
    NoAnswer,
    Question,
    Weights,
    front_of,
    question_of,
    range_of,
    route_with,
    weights_of,
)
from swarmctl.report.answers import weights_line

SLIDERS = (
    ("w", "w: 0 shortest, 1 least exposed"),
    ("direct", "firing strength, own cell"),
    ("first", "firing strength, first neighbours"),
    ("second", "firing strength, second neighbours"),
)
GREY = "#888888"
"""legible on light and on dark"""
NO_FRONT = "Choose one vehicle for its Pareto front."
Ghosts = list[dict[str, Any]]


class WhatIfPanel:
    """The routes that the chosen vehicle, or each vehicle, would fly with other weights at the time shown.

    `draw` shows ghosts on the map: routes with their colours.
    """

    def __init__(self, timeline: Timeline, draw: Callable[[Ghosts], None], send: Send | None = None) -> None:
        """`send` sends new weights to the swarm; None: it is only watched."""
        self._timeline = timeline
        self._draw = draw
        self._colours = dict(zip(timeline.area.names, timeline.area.colours, strict=True))
        self._whose, self._time_s = EVERYBODY, 0.0
        self._is_busy = self._is_outdated = False
        self._front: tuple[ShownRoute, ...] = ()
        self._w_of: list[float | None] = []
        self._values: dict[str, float] = {}
        self._sliders: dict[str, ui.slider] = {}
        self._title = ui.label().classes("font-semibold text-sm")
        with ui.element("div").classes("sliders"):
            for name, text in SLIDERS:
                slider = self._sliders[name] = _add_slider(text, 1.0, 0.01, "{:.2f}".format)
                slider.on("update:model-value", partial(self._moved, name), throttle=0.1)
            self._range = None if send is None else self._add_range()
        with ui.row().classes("w-full gap-2"):
            ui.button("Weights flown", on_click=self.reset).props("dense flat no-caps")
            ui.button("Pareto front", on_click=self._show_front).props("dense flat no-caps")
            if send is not None:
                ui.button("Apply", on_click=lambda: self._apply(send)).props("dense outline no-caps")
        self._text = ui.label().classes("text-xs whitespace-pre-line").props("aria-live=polite")
        self._front_text = ui.label().classes("text-xs").props("aria-live=polite")
        self._chart = ui.echart({}).classes("w-full").style("height: 240px")
        self._chart.on_point_click(self._choose_point)
        self._chart.set_visibility(False)
        self.reset()

    def _add_range(self) -> ui.slider | None:
        """Add the slider of the range of communication; None for a swarm with a real vehicle."""
        if not all(self._timeline.area.simulated):
            return None
        most = len(self._timeline.area.names) - 1
        text = "range of communication, nearest vehicles"
        return _add_slider(text, most, 1, lambda value: "all" if value == most else f"{value:g}")

    def choose(self, whose: str) -> None:
        """Turn to another vehicle, or to EVERYBODY."""
        self._whose = whose
        self.reset()

    def at(self, time_s: float) -> None:
        """Note the time shown; a route that is drawn stays until the next question."""
        self._time_s = time_s

    def reset(self) -> None:
        """Set the sliders to the weights flown, and take the ghosts off the map."""
        flown = weights_of(self._timeline, self._whose, self._time_s)
        fs = flown.strength
        values = flown.w, fs.direct, fs.first_neighbour, fs.second_neighbour
        for (name, _), value in zip(SLIDERS, values, strict=True):
            self._set(name, value)
        if self._range is not None:
            self._range.set_value(range_of(self._timeline, self._whose, self._time_s))
        self._title.set_text(f"Weights of {self._whose or 'all vehicles'}")
        self._text.set_text("Move a slider to see the routes that would be flown.")
        self._front_text.set_text("")
        self._chart.set_visibility(False)
        self._draw([])

    def _set(self, name: str, value: float) -> None:
        self._values[name] = value
        self._sliders[name].set_value(value)

    @property
    def _weights(self) -> Weights:
        value = self._values
        return Weights(value["w"], FiringStrength(value["direct"], value["first"], value["second"]))

    async def _moved(self, name: str, event: events.GenericEventArguments) -> None:
        """Search with the sliders' values; values that arrive during a search are searched afterwards."""
        self._values[name] = float(event.args)
        self._is_outdated = True
        if self._is_busy:
            return
        self._is_busy = True
        try:
            while self._is_outdated:
                self._is_outdated = False
                await self._answer()
        finally:
            self._is_busy = False

    async def _answer(self) -> None:
        try:
            weights = self._weights
        except ValueError as error:
            self._text.set_text(f"{error}")
            self._draw([])
            return
        names = [self._whose] if self._whose else list(self._timeline.area.names)
        questions, lines = self._questions(names)
        found = await run.io_bound(_answers, questions, weights)
        if found is None:
            return  # the server stops
        ghosts: Ghosts = []
        for name, (planned, answer) in found.items():
            if isinstance(answer, str):
                lines.append(f"{name}: {answer}")
                continue
            ghosts.append({"points": answer.points, "colour": self._colours[name]})
            rest = "" if planned is None else f"; its plan {planned}"
            lines.append(f"{name}: {answer}{rest}")
        self._draw(ghosts)
        self._text.set_text("\n".join([f"At {self._time_s:.0f} s, by these weights:", *lines]))

    def _questions(self, names: Sequence[str]) -> tuple[dict[str, Question], list[str]]:
        questions, lines = {}, []
        for name in names:
            try:
                questions[name] = question_of(self._timeline, name, self._time_s)
            except NoAnswer as error:
                lines.append(str(error))
        return questions, lines

    async def _apply(self, send: Send) -> None:
        """Send the sliders' weights to the chosen vehicle or to all, for their next plans."""
        try:
            weights = self._weights
        except ValueError as error:
            tell([str(error)], is_good=False)
            return
        fs = weights.strength
        strengths = fs.direct, fs.first_neighbour, fs.second_neighbour
        reach = self._range_wanted()
        request = SetWeights((self._whose,) if self._whose else None, weights.w, strengths, reach)
        await send_and_tell(send, request, lambda answer: weights_line(weights.w, fs, answer, reach))

    def _range_wanted(self) -> CommunicationRange | None:
        """Return the range of communication to apply; None in a swarm with a real vehicle."""
        if self._range is None:
            return None
        return "all" if self._range.value == self._range.props["max"] else int(self._range.value)

    # --- the Pareto front

    async def _show_front(self) -> None:
        if not self._whose:
            self._front_text.set_text(NO_FRONT)
            return
        try:
            question, weights = question_of(self._timeline, self._whose, self._time_s), self._weights
            found = await run.io_bound(front_of, question, weights)
        except ValueError as error:
            self._front_text.set_text(str(error))
            return
        if found is None:
            return
        front, self._front = found
        self._w_of = [None if ends is None else 0.5 * (ends[0] + ends[1]) for ends in front.w_ranges]
        note = "" if front.complete else " The front may lack routes that no w finds."
        self._front_text.set_text(
            f"{len(self._front)} routes of {self._whose} at {self._time_s:.0f} s. Click a point.{note}"
        )
        points = [[round(route.length_m, 1), route.exposure_sum] for route in self._front]
        self._chart.options.clear()
        self._chart.options.update(_front_options(points, self._colours[self._whose]))
        self._chart.update()
        self._chart.set_visibility(True)

    async def _choose_point(self, event: events.EChartPointClickEventArguments) -> None:
        route, w = self._front[event.data_index], self._w_of[event.data_index]
        self._draw([{"points": route.points, "colour": self._colours[self._whose]}])
        found_by = "only a search with a bound finds this route" if w is None else f"found with w = {w:.2f}"
        if w is not None:
            self._set("w", round(w, 2))
        self._front_text.set_text(f"{self._whose}: {route}; {found_by}")


def _answers(
    questions: dict[str, Question], weights: Weights
) -> dict[str, tuple[ShownRoute | None, ShownRoute | str]]:
    """Return the rest of the plan and the route for each question, or the reason why there is none."""
    found: dict[str, tuple[ShownRoute | None, ShownRoute | str]] = {}
    for name, question in questions.items():
        try:
            found[name] = question.rest_of_plan(weights.strength), route_with(question, weights)
        except NoAnswer as error:
            found[name] = None, str(error)
    return found


def _front_options(points: Sequence[Sequence[float]], colour: str) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "type": "value",
        "scale": True,
        "nameLocation": "middle",
        "nameTextStyle": {"color": GREY},
        "axisLabel": {"color": GREY},
        "splitLine": {"lineStyle": {"color": GREY, "opacity": 0.3}},
    }
    line = {"type": "line", "step": "end", "data": points, "symbolSize": 9, "lineStyle": {"width": 1}}
    return {
        "animation": False,
        "grid": {"left": 56, "right": 16, "top": 16, "bottom": 44},
        "tooltip": {"trigger": "item", "formatter": "{c}"},
        "xAxis": {**axis, "name": "length [m]", "nameGap": 28},
        "yAxis": {**axis, "name": "ΣP_s", "nameGap": 40},
        "series": [{**line, "color": colour}],
    }


def _add_slider(text: str, most: float, step: float, text_of: Callable[[float], str]) -> ui.slider:
    """Add a slider from 0 to `most`, below its text and its value as text."""
    with ui.column().classes("w-full gap-0"):
        with ui.row().classes("w-full items-center no-wrap gap-2"):
            ui.label(text).classes("text-xs grow")
            label = ui.label().classes("tabular-nums text-xs")
        slider = ui.slider(min=0.0, max=most, step=step, value=most).props(f'dense aria-label="{text}"')
    label.bind_text_from(slider, "value", text_of)
    return slider
