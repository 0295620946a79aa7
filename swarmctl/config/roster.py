"""As much of a configuration as it takes to speak to its vehicles: who they are, and how they are reached.

An order to an aircraft in flight does not wait for planners to be loaded and routes to be planned, and what
is wrong in a section that it does not need does not stop it. What flies is judged whole (`swarmctl.config.checks`).
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
from swarmctl.config.communication import Communication
from swarmctl.config.mesh import mesh_endpoints
from swarmctl.core.grid import Grid
from swarmctl.core.messages import MAX_SYSTEM_ID


@dataclass(frozen=True, slots=True)
class Roster:
    """A swarm as those see it who do not fly it."""

    name: str
    communication: Communication
    names: Mapping[int, str]
    """all vehicles, by system id"""
    grid: Grid


class RosterError(Exception):
    """What is wrong with a configuration; one line each, `file:line: key: what, what to do`."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


def load_roster(path: Path) -> Roster:
    """Read it from a configuration.

    Where anything in it cannot be understood the whole is judged. Raises NoRoll, with all that is wrong.
    """
    try:
        return _read(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError):  # pydantic's and YAML's errors are ValueErrors
        return _judged(path)


class _Part(BaseModel):
    """Other keys are for those who fly."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False, strict=True)


class _Area(_Part):
    origin_lat_deg: float
    origin_lon_deg: float
    rows: Annotated[int, Field(ge=1)]
    cols: Annotated[int, Field(ge=1)]
    cell_size_m: Annotated[float, Field(gt=0.0)]


class _Vehicle(_Part):
    name: str
    sysid: Annotated[int, Field(ge=1, le=MAX_SYSTEM_ID)]


class _Simulate(_Part):
    count: Annotated[int, Field(ge=1, le=MAX_SYSTEM_ID)]


class _Swarm(_Part):
    name: str = Field("swarm", pattern=SWARM_NAME)
    area: _Area
    communication: Communication = Communication()
    simulate: _Simulate | None = None
    vehicles: tuple[_Vehicle, ...] = ()


def _read(text: str) -> Roster:
    """Raises ValueError and TypeError."""
    data = yaml_lines.parse(text).data
    known = {key: data[key] for key in _Swarm.model_fields if key in data}
    # By way of JSON, which like YAML has lists alone where Python has tuples.
    found = _Swarm.model_validate_json(json.dumps(known))
    count = found.simulate.count if found.simulate is not None else 0
    who = [(n, f"uav{n}") for n in range(1, count + 1)] + [(v.sysid, v.name) for v in found.vehicles]
    names = dict(who)
    if not names or len(names) < len(who) or len(set(names.values())) < len(who):
        raise ValueError("no vehicle, or two of one name or system id")
    mesh_endpoints(found.communication.mesh, names)
    area = found.area
    grid = Grid(area.rows, area.cols, area.cell_size_m, area.origin_lat_deg, area.origin_lon_deg)
    return Roster(found.name, found.communication, names, grid)


def _judged(path: Path) -> Roster:
    """Raises NoRoll."""
    # What plans and flies takes a second to load, and is needed only to say what is wrong.
    from swarmctl.config.checks import check_config  # noqa: PLC0415
    from swarmctl.config.model import ConfigError, load  # noqa: PLC0415
    from swarmctl.config.scenario import build  # noqa: PLC0415

    try:
        scenario = build(load(path, check_config))
    except ConfigError as error:
        raise RosterError(error.lines) from None
    names = {spec.sysid: spec.name for spec in scenario.swarm}
    return Roster(scenario.config.name, scenario.config.communication, names, scenario.grid)
