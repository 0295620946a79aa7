"""The shipped configurations, by name, and the text of a starter configuration.

The files are in `configs/` of a checkout, and in `swarmctl/configs/` of the wheel.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from swarmctl.core.grid import Grid

_PACKAGE = Path(__file__).parents[1]
_FOLDERS = (_PACKAGE / "configs", _PACKAGE.parent / "configs")
MAX_STARTER_VEHICLES = 100


def example_names() -> list[str]:
    """Return the names of the shipped configurations."""
    return sorted(path.stem for path in _folder().glob("*.yaml"))


def example(name: str) -> Path:
    """Return the file of a shipped configuration. Raises ValueError for an unknown name."""
    names = example_names()
    if name not in names:
        raise ValueError(f"{name}: unknown example; the examples are {', '.join(names)}")
    return _folder() / f"{name}.yaml"


def _folder() -> Path:
    return next((folder for folder in _FOLDERS if (folder / "swarm.yaml").is_file()), _FOLDERS[-1])


def starter(file_name: str, n_vehicles: int, *, real: bool) -> str:
    """Return a commented configuration of `n_vehicles` vehicles: `real` vehicles by URL, else simulated.

    The text passes the checks unchanged. EDIT marks the lines to adapt to real vehicles.
    """
    cells_per_side = max(20, n_vehicles)
    grid = Grid(cells_per_side, cells_per_side, 50.0, 45.9860, 14.4200)
    parts = [_head(file_name, n_vehicles, real=real), _area(grid, real=real)]
    parts += [_REAL_THREATS if real else _SIMULATED_THREATS, _COMMON]
    parts += [_REAL_PREFLIGHT, *_vehicles(grid, n_vehicles)] if real else [_simulate(n_vehicles)]
    return "".join(parts)


def _head(file_name: str, n_vehicles: int, *, real: bool) -> str:
    what = f"{n_vehicles} vehicle{'s' if n_vehicles > 1 else ''}"
    title = f"{what} by MAVLink URL. Change every line marked EDIT." if real else f"{what}, simulated."
    steps = ("check", "plan", "preflight", "fly") if real else ("check", "plan", "fly")
    commands = [f"#   swarmctl {step} --config {file_name}" for step in steps]
    commands[-1] += " --real" if real else ""
    return "\n".join(
        [
            f"# {title}",
            "#",
            *commands,
            "#",
            "# `swarmctl schema` prints every key with its unit and its default.",
            "name: my-swarm               # name on the bus and in the run folder",
            "seed: 1                      # equal seeds give equal draws",
            "",
        ]
    )


def _area(grid: Grid, *, real: bool) -> str:
    edit = "EDIT: " if real else ""
    return f"""
area:                        # {edit}cells; row 0 is in the south, column 0 in the west
  origin_lat_deg: {grid.origin_lat_deg:.4f}    # {edit}south-west corner
  origin_lon_deg: {grid.origin_lon_deg:.4f}    # {edit}south-west corner
  rows: {grid.rows}
  cols: {grid.cols}
  cell_size_m: {grid.cell_size_m:g}
  # no_fly: [[9, 9], [9, 10]]  # cells [row, col] that no route enters
"""


_SIMULATED_THREATS = """
threats:
  count: 24                  # announced number of hostiles
  hostiles: random           # true cells, drawn with the seed; or a list [[row, col], …]
"""

_REAL_THREATS = """
threats:
  count: 24                  # EDIT: number of hostiles that the agents expect

sensor:
  source: external           # no simulated sensor: `swarmctl observe` and payloads report observations
"""

_COMMON = """
planner:
  name: dijkstra
  w: 0.5                     # 0: the shortest routes, 1: the least exposed

flight:
  altitude_m: 40             # of the first vehicle, above home
  altitude_step_m: 5         # each vehicle flies this much higher than the previous one
  on_exit: return            # on Ctrl-C: return, land or hold

separation:                  # two vehicles keep at least one of these distances
  horizontal_m: 10
  vertical_m: 3

# communication: {range: 2, loss: 0.1}   # a model of the radio between the vehicles
"""

_REAL_PREFLIGHT = """
preflight:
  endurance_s: 900           # EDIT: flight time of a full battery [s]
  set_parameters: false      # true: `fly` writes the parameters of the policy to the vehicles
  policy:                    # reactions of the autopilots; their parameters must agree
    lost_link: return
    lost_link_after_s: 10
    low_battery: return
    fence_breach: return

vehicles:
"""


def _simulate(n_vehicles: int) -> str:
    return f"""
simulate:
  count: {n_vehicles}
  speedup: 10                # simulated seconds in a second of real time
  autopilot: ardupilot       # or px4, or mixed
  start_side: west           # side of the area along which the vehicles start
  start_distance_m: 60       # distance of the starts from the area
  goal_side: east            # side of the area along which the goals are
"""


def _vehicles(grid: Grid, n_vehicles: int) -> Iterator[str]:
    """Yield lines for vehicles that start west of the area, each in another row, with goals in the east."""
    for i in range(n_vehicles):
        row = (2 * i + 1) * grid.rows // (2 * n_vehicles)
        _, north_m = grid.centre_m((row, 0))
        lat_deg, lon_deg = grid.frame.to_geodetic(-60.0, north_m)
        forms = "or udpout://HOST:PORT, tcpout://HOST:PORT, serial:///dev/ttyUSB0:57600"
        lines = [
            (f"  - name: uav{i + 1}", ""),
            ("    url: udpin://0.0.0.0:14550", forms),
            (f"    sysid: {i + 1}", "MAVLink system id"),
            (f"    start: {{lat_deg: {lat_deg:.6f}, lon_deg: {lon_deg:.6f}}}", "position before take-off"),
            (f"    goal: [{row}, {grid.cols - 1}]", "cell [row, col]"),
            ("    speed_m_s: 10", "cruise speed over ground [m/s]"),
        ]
        yield from (f"{key:<34} # EDIT: {text}\n" if text else f"{key}\n" for key, text in lines)
