"""The study: its figures with points to click, the worlds of a point, and the missions of these worlds."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import events, run, ui

from swarmctl.dashboard import style
from swarmctl.dashboard.page import Page
from swarmctl.dashboard.sources.study import Chart, StudySource, WorldResult, option_of
from swarmctl.report.foxglove import colour_of

ROWS_A_PAGE = 12
STYLE = """
.study { display: grid; grid-template-columns: minmax(0, 1fr) 420px; gap: 16px; padding: 0 12px; width: 100% }
@media (max-width: 1000px) { .study { grid-template-columns: minmax(0, 1fr) } }
.study .worlds { position: sticky; top: 8px; align-self: start }
"""
LINK = """<q-td :props="props"><a class="text-primary underline" :href="props.row.link"
 :aria-label="'Replay world ' + props.row.seed">{{ props.row.seed }}</a></q-td>"""


class StudyPage:
    """The study page of one browser."""

    def __init__(self, source: StudySource) -> None:
        self._source = source
        self._charts: list[ui.echart] = []
        self._levels: tuple[int, ...] = ()
        self._dark = ui.dark_mode(value=None)
        ui.add_css(style.COMMON + STYLE)
        with ui.row().classes("w-full items-center gap-3 px-3 py-1"):
            ui.label(source.experiment.section.question).classes("text-lg font-semibold grow")
            ui.checkbox("Dark", on_change=self._set_dark)
        with ui.element("div").classes("study"):
            with ui.column().classes("w-full gap-4"):
                for chart in source.charts():
                    self._add_chart(chart)
                for title, caption, path in source.pictures():
                    ui.label(title).classes("font-semibold")
                    ui.image(path).classes("w-full bg-white").style("max-width: 640px").props(
                        f'alt="{title or path.stem}"'
                    )
                    ui.label(f"{caption} This figure is a picture, without points to click.").classes(
                        "text-xs"
                    )
            with ui.column().classes("worlds w-full gap-2"):
                names = dict(enumerate(source.names))
                self._level = ui.select(names, label="Worlds of the level", on_change=self._choose)
                self._level.classes("w-full").props("dense outlined options-dense")
                self._beside = ui.select(
                    {None: "nothing", **names}, value=None, label="Show beside it", on_change=self._list
                )
                self._beside.classes("w-full").props("dense outlined options-dense")
                self._worlds = ui.column().classes("w-full")

    def _add_chart(self, chart: Chart) -> None:
        ui.label(chart.title).classes("font-semibold")
        shown = ui.echart(option_of(chart, [colour_of(i) for i in range(len(chart.series))]))
        shown.classes("w-full").style("height: 320px").props(f'role=img aria-label="{chart.title}"')
        shown.on_point_click(partial(self._clicked, chart))
        self._charts.append(shown)
        ui.label(chart.caption).classes("text-xs")

    # --- what the person does

    def _clicked(self, chart: Chart, event: events.EChartPointClickEventArguments) -> None:
        points = list(chart.series.values())[event.series_index]
        self._levels = points[event.data_index].levels
        self._level.set_value(self._levels[0] if len(self._levels) == 1 else None)
        self._list()

    def _choose(self, event: events.ValueChangeEventArguments[Any]) -> None:
        if event.value is not None:
            self._levels = (event.value,)
            self._list()

    def _list(self) -> None:
        self._worlds.clear()
        if not self._levels:
            return
        worlds = self._source.worlds(self._levels)
        with self._worlds:
            text = "; ".join(self._source.names[level] for level in self._levels)
            ui.label(f"{len(worlds)} worlds of {text}").classes("text-sm")
            rows = [self._row(world) for world in worlds]
            columns: list[dict[str, Any]] = [
                {"name": name, "label": label, "field": name, "sortable": True, "align": "right"}
                for name, label in (
                    ("seed", "World"),
                    ("strikes", "Strikes a vehicle"),
                    ("length_m", "Length [m]"),
                    ("arrived", "Arrived [%]"),
                )
            ]
            table = ui.table(rows=rows, columns=columns, row_key="link", pagination=ROWS_A_PAGE)
            table.classes("w-full").props("dense flat")
            if self._source.has_missions:
                table.add_slot("body-cell-seed", LINK)

    def _row(self, world: WorldResult) -> dict[str, Any]:
        beside = "" if self._beside.value is None else f"&beside={self._beside.value}"
        values = world.values
        return {
            "seed": world.seed,
            "link": f"/world?level={world.level}&seed={world.seed}{beside}",
            "strikes": round(values.get("strikes", 0.0), 2),
            "length_m": round(values.get("length_m", 0.0)),
            "arrived": round(100.0 * values.get("arrived", 0.0)),
        }

    def _set_dark(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._dark.value = event.value
        ink = "#e6e6e6" if event.value else "#202020"
        for chart in self._charts:
            chart.options["textStyle"] = {"color": ink}
            chart.options["legend"]["textStyle"] = {"color": ink}
            for axis in ("xAxis", "yAxis"):
                shown = chart.options[axis]
                shown["axisLabel"] = {**shown.get("axisLabel", {}), "color": ink}
                shown["nameTextStyle"] = {"color": ink}
                shown["splitLine"] = {"lineStyle": {"color": "#3a3a3a" if event.value else "#e0e0e0"}}
            chart.update()


def register(source: StudySource) -> None:
    """Serve the study at the root of the application, and its missions below."""

    @ui.page("/", title=f"{source.folder.name} · swarmctl", response_timeout=30.0)
    def root() -> None:
        StudyPage(source)

    @ui.page("/world", title=f"{source.folder.name} · swarmctl", response_timeout=120.0)
    async def world(level: int, seed: int, beside: int | None = None) -> None:
        levels = [level] if beside is None or beside == level else [level, beside]
        timelines = []
        for each in levels:
            try:
                timeline = await run.io_bound(source.mission, each, seed)
            except (ValueError, IndexError) as error:
                ui.label(str(error))
                return
            if timeline is None:
                return  # the server stops
            timelines.append(timeline)
        common, different = source.headings(levels)
        heading = ": ".join(filter(None, (f"World {seed}", common)))
        Page(dict(zip(different, timelines, strict=True)), back=("/", "Study"), heading=heading)
