"""The scenario file: which vehicles stand where, and what threatens them."""

import json
import math
from collections import Counter
from pathlib import Path
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim_vehicle.personalities import PERSONALITIES

Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]
Probability = Annotated[float, Field(ge=0, le=1)]
SPACING_M = 5.0  # between the vehicles of a fleet that is only counted
METRES_PER_DEGREE = 111_320.0


class ScenarioError(ValueError):
    """The scenario cannot be used; the text says where and why, one line a finding."""


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class VehicleSpec(_Strict):
    """One vehicle: system id and where it stands; `params` are set at its first boot."""

    sysid: Annotated[int, Field(ge=1, le=250)]
    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Annotated[float, Field(ge=-500, le=9000)] = 10.0
    params: dict[str, float] = {}

    @model_validator(mode="after")
    def _parameters_exist(self) -> Self:
        known = PERSONALITIES["ardupilot"].parameters
        unknown = sorted(set(self.params) - set(known))
        if unknown:
            raise ValueError(f"no such parameters: {', '.join(unknown)}; known: {', '.join(sorted(known))}")
        return self


class Area(_Strict):
    """The square cells; the origin is the south-west corner of cell (0, 0)."""

    origin_lat_deg: Latitude
    origin_lon_deg: Longitude
    rows: Annotated[int, Field(ge=1)]
    cols: Annotated[int, Field(ge=1)]
    cell_size_m: Annotated[float, Field(gt=0)]


class Scenario(_Strict):
    """Everything a fleet starts from."""

    seed: Annotated[int, Field(ge=0)] = 0
    vehicles: Annotated[list[VehicleSpec], Field(min_length=1, max_length=250)]
    area: Area | None = None
    firing_strength: tuple[Probability, Probability, Probability] | None = None
    hostiles: list[tuple[int, int]] = []

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        twice = [sysid for sysid, n in Counter(v.sysid for v in self.vehicles).items() if n > 1]
        if twice:
            raise ValueError(f"system ids must differ, but these occur more than once: {twice}")
        if self.firing_strength is not None:
            own, nearest, diagonal = self.firing_strength
            if not own > nearest > diagonal:
                raise ValueError(
                    f"firing_strength must decrease (Eq. 1: own cell, nearest, diagonal), "
                    f"found {own}, {nearest}, {diagonal}"
                )
        if self.hostiles:
            self._check_hostiles()
        return self

    def _check_hostiles(self) -> None:
        if self.area is None or self.firing_strength is None:
            raise ValueError("hostiles need `area` and `firing_strength` as well")
        rows, cols = self.area.rows, self.area.cols
        outside = [cell for cell in self.hostiles if not (0 <= cell[0] < rows and 0 <= cell[1] < cols)]
        if outside:
            raise ValueError(f"hostiles {outside} are outside the area of {rows} rows and {cols} columns")
        twice = [cell for cell, n in Counter(self.hostiles).items() if n > 1]
        if twice:
            raise ValueError(f"a cell holds at most one hostile, but these are named twice: {twice}")


def load_scenario(path: Path) -> Scenario:
    """Read and check a scenario file; ScenarioError says what is wrong with it."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: is not UTF-8 text") from error
    try:
        return Scenario.model_validate(json.loads(text))
    except json.JSONDecodeError as error:
        raise ScenarioError(f"{path}:{error.lineno}:{error.colno}: not valid JSON: {error.msg}") from error
    except ValidationError as error:
        lines = []
        for finding in error.errors():
            where = ".".join(str(part) for part in finding["loc"]) or "scenario"
            lines.append(f"{path}: {where}: {finding['msg'].removeprefix('Value error, ')}")
        raise ScenarioError("\n".join(lines)) from error


def default_scenario(
    count: int, *, home: tuple[float, float, float], first_sysid: int = 1, seed: int = 0
) -> Scenario:
    """`count` copters side by side, eastward from home (latitude, longitude [deg], altitude [m])."""
    lat_deg, lon_deg, alt_amsl_m = home
    step_deg = SPACING_M / (METRES_PER_DEGREE * max(math.cos(math.radians(lat_deg)), 0.01))
    try:
        return Scenario(
            seed=seed,
            vehicles=[
                VehicleSpec(
                    sysid=first_sysid + i,
                    lat_deg=lat_deg,
                    lon_deg=lon_deg + i * step_deg,
                    alt_amsl_m=alt_amsl_m,
                )
                for i in range(count)
            ],
        )
    except ValidationError as error:
        finding = error.errors()[0]
        raise ScenarioError(f"{'.'.join(map(str, finding['loc']))}: {finding['msg']}") from error
