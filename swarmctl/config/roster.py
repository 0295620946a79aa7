"""The roster of a swarm: its vehicles, area and network, the part of a configuration that orders need.

An order to a vehicle in flight loads no planner and plans no route. Errors in other sections do not stop the
order. A flight checks the whole configuration (`swarmctl.config.checks`).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from swarmctl.bus.keys import SWARM_NAME
from swarmctl.config import yaml_lines
from swarmctl.config.communication import Communication, mesh_endpoints
from swarmctl.core.grid import Grid
from swarmctl.core.messages import MAX_SYSTEM_ID
from swarmctl.core.operator_text import VEHICLE_NAME


@dataclass(frozen=True, slots=True)
class Roster:
    """The vehicles and the network of a swarm, for commands that fly no vehicle."""

    name: str
    communication: Communication
    names: Mapping[int, str]
    """names of all vehicles, by system id"""
    grid: Grid


class RosterError(Exception):
    """All errors of a configuration; `lines` as in `ConfigError`."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


def load_roster(path: Path) -> Roster:
    """Return the roster of a configuration file.

    After an error in the roster's part, the whole configuration is checked. Raises RosterError.
    """
    try:
        return _from_roster_part(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError):  # pydantic's and YAML's errors are ValueErrors
        return _from_whole_configuration(path)


class _Part(BaseModel):
    """A part of a section; other keys are ignored."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False, strict=True)


class _Area(_Part):
    origin_lat_deg: float
    origin_lon_deg: float
    rows: Annotated[int, Field(ge=1)]
    cols: Annotated[int, Field(ge=1)]
    cell_size_m: Annotated[float, Field(gt=0.0)]


class _Vehicle(_Part):
    name: Annotated[str, Field(pattern=VEHICLE_NAME)]
    sysid: Annotated[int, Field(ge=1, le=MAX_SYSTEM_ID)]


class _Simulate(_Part):
    count: Annotated[int, Field(ge=1, le=MAX_SYSTEM_ID)]


class _Swarm(_Part):
    name: str = Field("swarm", pattern=SWARM_NAME)
    area: _Area
    communication: Communication = Communication()
    simulate: _Simulate | None = None
    vehicles: tuple[_Vehicle, ...] = ()


def _from_roster_part(text: str) -> Roster:
    """Return the roster of a YAML text. Raises ValueError and TypeError."""
    data = yaml_lines.parse(text).data
    known = {key: data[key] for key in _Swarm.model_fields if key in data}
    # Strict validation of JSON accepts lists for tuples; strict validation of Python objects does not.
    found = _Swarm.model_validate_json(json.dumps(known))
    count = found.simulate.count if found.simulate is not None else 0
    pairs = [(n, f"uav{n}") for n in range(1, count + 1)] + [(v.sysid, v.name) for v in found.vehicles]
    names = dict(pairs)
    if not names or len(names) < len(pairs) or len(set(names.values())) < len(pairs):
        raise ValueError("no vehicle, or two vehicles with one name or system id")
    mesh_endpoints(found.communication.mesh, names)
    area = found.area
    grid = Grid(area.rows, area.cols, area.cell_size_m, area.origin_lat_deg, area.origin_lon_deg)
    return Roster(found.name, found.communication, names, grid)


def _from_whole_configuration(path: Path) -> Roster:
    """Return the roster from the whole configuration, with all its checks. Raises RosterError."""
    # The modules that plan and fly take a second to load, so other commands do not import them.
    from swarmctl.config.checks import check_config  # noqa: PLC0415
    from swarmctl.config.model import ConfigError, load  # noqa: PLC0415
    from swarmctl.config.scenario import build  # noqa: PLC0415

    try:
        scenario = build(load(path, check_config))
    except ConfigError as error:
        raise RosterError(error.lines) from None
    names = {spec.sysid: spec.name for spec in scenario.swarm}
    return Roster(scenario.config.name, scenario.config.communication, names, scenario.grid)
