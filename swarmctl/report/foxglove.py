"""Messages in Foxglove's own schemas, and the layout that shows them. Pure.

Names and fields: https://docs.foxglove.dev/docs/visualization/message-schemas (Log, LocationFix, GeoJSON).
The schemas here hold only the fields that are written.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from typing import Any

from swarmctl.core.geo import LatLon
from swarmctl.core.grid import Cell, Grid
from swarmctl.core.mission import FlightPlan
from swarmctl.core.vehicle import VehicleState

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#5B4A8A")
"""colours of the vehicles in order, repeated: six of Okabe and Ito's colours, and a violet"""
AREA, HOSTILES, FOUND, LOG = "/map/area", "/map/hostiles", "/map/found", "/log"
"""topics of the whole run; each vehicle also has `/NAME/location` and `/NAME/route`"""

_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}
_COLOUR = {
    "type": "object",
    "title": "foxglove.Color",
    "properties": {channel: {"type": "number"} for channel in "rgba"},
}


def _schema(title: str, **properties: Any) -> dict[str, Any]:
    return {"title": title, "type": "object", "properties": properties, "required": sorted(properties)}


_TEXT, _NUMBER, _INTEGER = {"type": "string"}, {"type": "number"}, {"type": "integer"}
SCHEMAS: Mapping[str, dict[str, Any]] = {
    schema["title"]: schema
    for schema in (
        _schema(
            "foxglove.Log",
            timestamp=_TIME,
            level=_INTEGER,
            message=_TEXT,
            name=_TEXT,
            file=_TEXT,
            line=_INTEGER,
        ),
        _schema(
            "foxglove.LocationFix",
            timestamp=_TIME,
            frame_id=_TEXT,
            latitude=_NUMBER,
            longitude=_NUMBER,
            altitude=_NUMBER,
            position_covariance={"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
            position_covariance_type=_INTEGER,
            color=_COLOUR,
        ),
        _schema("foxglove.GeoJSON", geojson=_TEXT),
    )
}


class LogLevel(IntEnum):
    """`foxglove.LogLevel`."""

    DEBUG = 1
    INFO = 2
    WARNING = 3


def colour_of(index: int) -> str:
    """Return the colour of the vehicle `index` of the swarm as #rrggbb."""
    return COLOURS[index % len(COLOURS)]


def location_topic(name: str) -> str:
    return f"/{name}/location"


def route_topic(name: str) -> str:
    return f"/{name}/route"


def log(time_ns: int, name: str, text: str, level: LogLevel) -> dict[str, Any]:
    """Return a `foxglove.Log` of the vehicle `name`."""
    return {
        "timestamp": _time(time_ns), "level": level, "message": text, "name": name, "file": "", "line": 0,
    }  # fmt: skip


def location_fix(time_ns: int, name: str, state: VehicleState, hex_colour: str) -> dict[str, Any]:
    """Return a `foxglove.LocationFix`; `state` must have a position. An unknown altitude becomes 0 m."""
    red, green, blue = (int(hex_colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return {
        "timestamp": _time(time_ns),
        "frame_id": name,
        "latitude": state.lat_deg,
        "longitude": state.lon_deg,
        "altitude": state.alt_amsl_m or 0.0,
        "position_covariance": [0.0] * 9,
        "position_covariance_type": 0,
        "color": {"r": red, "g": green, "b": blue, "a": 1.0},
    }


def route(name: str, plan: FlightPlan, hex_colour: str) -> dict[str, Any]:
    """Return a `foxglove.GeoJSON` of a vehicle's new mission."""
    points = [*((w.lat_deg, w.lon_deg) for w in plan.waypoints), (plan.landing.lat_deg, plan.landing.lon_deg)]
    return _collection([_feature("LineString", _positions(points), f"route of {name}", color=hex_colour)])


def area(grid: Grid, no_fly: Iterable[Cell], goals: Iterable[Cell]) -> dict[str, Any]:
    """Return a `foxglove.GeoJSON` of the area's outline, its no-fly cells and its goals."""
    outline = [*grid.corners(), grid.corners()[0]]
    features = [_feature("LineString", _positions(outline), "area", color="#444444")]
    features += [_square(grid, cell, "no-fly", "#7f7f7f") for cell in sorted(no_fly)]
    features += [_square(grid, cell, "goal", "#2ca02c") for cell in sorted(set(goals))]
    return _collection(features)


def hostiles(grid: Grid, cells: Iterable[Cell], label: str) -> dict[str, Any]:
    """Return a `foxglove.GeoJSON` of the cells with a hostile."""
    return _collection([_square(grid, cell, label, "#d62728") for cell in sorted(cells)])


def layout(names: Sequence[str], centre: LatLon) -> dict[str, Any]:
    """Return a layout for Foxglove: the map, beside the log and the heights above home."""
    colours = {location_topic(name): colour_of(i) for i, name in enumerate(names)}
    heights = [
        {
            "value": f'/events{{vehicle=="{name}"}}.event.state.alt_rel_m',
            "enabled": True,
            "timestampMethod": "receiveTime",
            "label": name,
            "color": colour_of(i),
        }
        for i, name in enumerate(names)
    ]
    return {
        "configById": {
            "map!swarm": {
                "center": {"lat": centre[0], "lon": centre[1]},
                "zoomLevel": 14,
                "layer": "map",
                "followTopic": "",
                "disabledTopics": [],
                "topicColors": colours,
                "customTileUrl": "",
                "maxNativeZoom": 18,
            },
            "RosOut!log": {"searchTerms": [], "minLogLevel": 1},
            "Plot!height": {
                "title": "height above home [m]",
                "paths": heights,
                "showLegend": True,
                "showXAxisLabels": True,
                "showYAxisLabels": True,
                "xAxisVal": "timestamp",
                "isSynced": True,
            },
        },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "first": "map!swarm",
            "second": {"direction": "column", "first": "RosOut!log", "second": "Plot!height"},
            "splitPercentage": 60,
        },
    }


def _time(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // 10**9, "nsec": time_ns % 10**9}


def _collection(features: list[dict[str, Any]]) -> dict[str, Any]:
    return {"geojson": json.dumps({"type": "FeatureCollection", "features": features})}


def _positions(points: Iterable[LatLon]) -> list[list[float]]:
    """Return GeoJSON positions: longitude before latitude (RFC 7946, section 3.1.1)."""
    return [[round(lon_deg, 7), round(lat_deg, 7)] for lat_deg, lon_deg in points]


def _square(grid: Grid, cell: Cell, name: str, hex_colour: str) -> dict[str, Any]:
    east_m, north_m = grid.centre_m(cell)
    half_m = grid.cell_size_m / 2.0
    corners_m = [(east_m + e * half_m, north_m + n * half_m) for e, n in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    ring = [grid.frame.to_geodetic(*corner) for corner in (*corners_m, corners_m[0])]
    return _feature("Polygon", [_positions(ring)], name, color=hex_colour, fillOpacity=0.3)


def _feature(kind: str, coordinates: list[Any], name: str, **style: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {"name": name, "style": {"weight": 2, **style}},
    }
