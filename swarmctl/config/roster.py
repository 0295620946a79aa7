"""The roster of a swarm: its vehicles, area and network, the part of a configuration that orders need.

An order to a vehicle in flight loads no planner and plans no route. Errors in other keys do not stop the
order, so these models ignore unknown keys. `Config` adds the other keys, and a flight checks all of them
(`swarmctl.config.checks`).
"""

from __future__ import annotations

import contextlib
from pathlib import Path

from pydantic import Field

from swarmctl.bus.keys import SWARM_NAME
from swarmctl.config import yaml_lines
from swarmctl.config.communication import Communication, mesh_endpoints
from swarmctl.core.grid import Grid
from swarmctl.core.operator_text import VEHICLE_NAME
from swarmctl.core.section import Section


class GridArea(Section, extra="ignore"):
    """The grid of the area."""

    origin_lat_deg: float = Field(
        ge=-89.0, le=89.0, description="Latitude of the south-west corner, WGS 84 [deg]."
    )
    origin_lon_deg: float = Field(
        ge=-180.0, le=180.0, description="Longitude of the south-west corner, WGS 84 [deg]."
    )
    rows: int = Field(
        ge=1, le=10_000, description="Number of cells from south to north. Row 0 is the southernmost."
    )
    cols: int = Field(
        ge=1, le=10_000, description="Number of cells from west to east. Column 0 is the westernmost."
    )
    cell_size_m: float = Field(gt=0.0, description="Side of a cell [m].")


class SimulatedCount(Section, extra="ignore"):
    """The number of simulated vehicles."""

    count: int = Field(ge=1, le=250, description="Number of simulated vehicles, named uav1, uav2, ….")


class NamedVehicle(Section, extra="ignore"):
    """The names of a vehicle."""

    name: str = Field(
        pattern=VEHICLE_NAME,
        description="Name of the vehicle in commands, reports and names of files: up to 32 letters, digits "
        "and `_.-`, with a letter, a digit or `_` first.",
    )
    sysid: int = Field(ge=1, le=254, description="MAVLink system id of the vehicle.")


class Roster(Section, extra="ignore"):
    """The vehicles, the area and the network of a swarm."""

    name: str = Field(
        "swarm", pattern=SWARM_NAME, description="Name of the swarm on the bus and in the run folder."
    )
    area: GridArea
    communication: Communication = Field(
        Communication(), description="Transport, endpoints and radio model of the UAVs' messages."
    )
    simulate: SimulatedCount | None = None
    vehicles: tuple[NamedVehicle, ...] = ()

    @property
    def identities(self) -> list[tuple[int, str]]:
        """System id and name of each vehicle: those of `simulate`, followed by `vehicles`."""
        count = 0 if self.simulate is None else self.simulate.count
        return [(n, f"uav{n}") for n in range(1, count + 1)] + [(v.sysid, v.name) for v in self.vehicles]

    @property
    def names(self) -> dict[int, str]:
        """The names of all vehicles, by system id."""
        return dict(self.identities)

    @property
    def grid(self) -> Grid:
        area = self.area
        return Grid(area.rows, area.cols, area.cell_size_m, area.origin_lat_deg, area.origin_lon_deg)


def load_roster(path: Path) -> Roster:
    """Return the roster of a configuration file.

    After an error in the roster's part, the whole configuration is checked. Raises ConfigError.
    """
    with contextlib.suppress(OSError, ValueError):  # pydantic's and YAML's errors are ValueErrors
        roster = Roster.model_validate(yaml_lines.parse(path.read_text(encoding="utf-8")).data)
        names = roster.names
        mesh_endpoints(roster.communication.mesh, names)
        if 0 < len(roster.identities) == len(names) == len(set(names.values())):
            return roster
    # The modules that plan and fly take a second to load, so other commands do not import them.
    from swarmctl.config.checks import check_config  # noqa: PLC0415
    from swarmctl.config.model import load  # noqa: PLC0415

    return load(path, check_config)
