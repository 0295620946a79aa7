"""Real autopilots in software, flown by `swarmctl fly --real` in a network of their own."""

from __future__ import annotations

import contextlib
import functools
import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from firmware_builds import Builds
from firmware_witness import Seen, Witness
from flown_cells import Flown, flown
from namespaces import BridgedNetwork, Process, bridged_network
from swarmctl_process import ROOT, SWARMCTL
from udp_relay import Radio, Relay

from swarmctl.config.model import Config, load
from swarmctl.config.scenario import Scenario, build
from swarmctl.config.specs import Spec
from swarmctl.core.geo import LatLon, distance_m
from swarmctl.core.grid import Cell

DESK, BRIDGE, ADDRESS = "desk", "air", "10.231.9.1"
STATION_PORT, WITNESS_PORT = 14701, 14549
"""14549 is where the companion link of every PX4 from instance 10 on goes"""
PX4_PORT = 14550
GROUND_AMSL_M = 300.0
BOOT_SPEEDUP = 5
"""ArduPilot's clock until it has a position: 8 s of 41"""
POSITION_S = 120.0
"""time limit for a position after the start, on a busy machine"""
COLUMN_S = 300.0
FLOWN = "flown"
"""name of the lines about a flight among the properties of a test"""
PX4_FIRST_SYSID = 20 + os.getpid() % 25 * 8
"""PX4's lock and socket in /tmp have the number of the instance: another process of tests has others"""

NAME = f"firmware-{os.getpid()}"
"""commands beside a flight find all swarms of a machine, by name"""

ARDUPILOT_PARAMETERS = {"LOG_BACKEND_TYPE": 0}
COPTER_PARAMETERS = {"ANGLE_MAX": 4500}
"""centidegrees; at the default of 30 degrees the simulated frame flies no faster than 10.1 m/s"""
PLANE_PARAMETERS = {"AIRSPEED_CRUISE": 15, "BATT_LOW_VOLT": 10.5}
PX4_PARAMETERS = {"SDLOG_MODE": -1, "SIH_LOC_H0": GROUND_AMSL_M, "SIH_KDV": 0.16}
"""with the default drag of SIH, 10 m/s need the greatest tilt"""


def swarm(
    kinds: Sequence[str],
    example: str = "swarm",
    *,
    cells: int | None = None,
    policy: dict[str, str] | None = None,
    simulated: dict[str, Any] | None = None,
    **sections: Any,
) -> dict[str, Any]:
    """Return a shipped configuration with firmware in place of its simulated vehicles.

    `kinds`: the option of each vehicle. `cells`: another number of rows and of columns, with as many hostiles
    for each cell. `policy`: reactions of the autopilots that differ from the defaults. `simulated`: other
    keys of `simulate`, such as speed and goal. `sections`: sections that replace the shipped ones.
    """
    content = yaml.safe_load((ROOT / "configs" / f"{example}.yaml").read_text())
    if cells is not None:
        area, threats = content["area"], content["threats"]
        threats["count"] = round(threats["count"] * cells**2 / (area["rows"] * area["cols"]))
        area["rows"] = area["cols"] = cells
    simulate = {**content["simulate"], **(simulated or {}), "count": len(kinds), "speedup": 1}
    simulate["autopilot"] = ["arduplane" if kind == "arduplane" else "ardupilot" for kind in kinds]
    specs = build(Config.model_validate_json(json.dumps({**content, **sections, "simulate": simulate}))).specs
    del content["simulate"]
    px4_sysid = PX4_FIRST_SYSID
    vehicles = []
    for kind, spec in zip(kinds, specs, strict=True):
        sysid = spec.sysid
        if kind == "px4":
            sysid, px4_sysid = px4_sysid, px4_sysid + 1
        vehicles.append(
            {
                "name": spec.name,
                "sysid": sysid,
                "url": f"udpin://127.0.0.1:{PX4_PORT if kind == 'px4' else STATION_PORT}",
                "airframe": spec.airframe,
                "start": {"lat_deg": spec.start[0], "lon_deg": spec.start[1]},
                "goal": [list(goal) for goal in spec.goals],
                "speed_m_s": spec.speed_m_s,
                "altitude_m": spec.altitude_m,
            }
        )
    preflight = {
        "set_parameters": True,
        "endurance_s": 1200,
        "clock_tolerance_s": 120,
        "policy": policy or {},
    }
    return {**content, "name": NAME, "preflight": preflight, **sections, "vehicles": vehicles}


@dataclass
class Airfield:
    """Autopilots on the ground, a witness, and the machine on which `swarmctl` runs."""

    net: BridgedNetwork
    builds: Builds
    folder: Path
    content: dict[str, Any]
    kinds: Sequence[str]
    witness: Witness
    relay: Relay
    keep: Callable[[str, object], None]
    """keeps a line about a vehicle's flight, by pytest's `record_property`"""
    autopilots: dict[str, Process] = field(default_factory=dict)
    starts: int = 0

    @functools.cached_property
    def scenario(self) -> Scenario:
        return build(load(self.config))

    def await_column(self, name: str, col: int) -> Cell:
        """Wait until a vehicle flies over a column of the area, and return its cell."""
        seen = self.witness[self.sysids[name]]

        def is_there(_: Witness) -> bool:
            cell = self._cell(seen)
            return cell is not None and cell[1] >= col

        self.witness.until(is_there, f"{name} in column {col}", COLUMN_S)
        cell = self._cell(seen)
        assert cell is not None
        return cell

    def _cell(self, seen: Seen) -> Cell | None:
        """Return the cell of the last position of a vehicle."""
        if not seen.fixes:
            return None
        return self.scenario.grid.cell_at(seen.fixes[-1].lat_deg, seen.fixes[-1].lon_deg)

    @property
    def config(self) -> Path:
        return self.folder / "swarm.yaml"

    @property
    def sysids(self) -> dict[str, int]:
        return {vehicle["name"]: vehicle["sysid"] for vehicle in self.content["vehicles"]}

    @property
    def run(self) -> Path:
        """The folder of the only flight."""
        (run,) = (self.folder / "runs").iterdir()
        return run

    def flown(self, **until_s: float) -> dict[str, Flown]:
        """Return the ended flight of each vehicle.

        The comparison with plans ends at a time by name, and for a plane at its goal, over which it circles.
        """
        grid, found = self.scenario.grid, {}
        for name, sysid in self.sysids.items():
            fixes, spec = self.witness[sysid].flown(), self._spec(name)
            ends_s = until_s.get(name, math.inf)
            if spec.airframe == "plane":
                at_goal = (fix.at_s for fix in fixes if grid.cell_at(fix.lat_deg, fix.lon_deg) in spec.goals)
                ends_s = next(at_goal, ends_s)
            found[name] = flown(self.run, name, fixes, grid, ends_s)
            self.keep(FLOWN, str(found[name]))
        return found

    def distance_from_m(self, name: str, place: LatLon) -> float:
        """Return the distance of a vehicle's last position from a place."""
        at = self.witness[self.sysids[name]].fixes[-1]
        return distance_m((at.lat_deg, at.lon_deg), place)

    def distance_from_goal_m(self, name: str) -> float:
        centre = self.scenario.grid.centre
        return min(self.distance_from_m(name, centre(goal)) for goal in self._spec(name).goals)

    def distance_from_start_m(self, name: str) -> float:
        return self.distance_from_m(name, self._spec(name).start)

    def _spec(self, name: str) -> Spec:
        return next(one for one in self.scenario.specs if one.name == name)

    def fly(self) -> Process:
        """Start `swarmctl fly` as a user would."""
        words = ["fly", "--config", str(self.config), "--real", "--confirm", ",".join(self.sysids)]
        words += ["--out", str(self.folder / "runs"), "--verbose"]
        return self.net.start(DESK, [*SWARMCTL, *words], self.folder / "fly.log")

    def swarmctl(self, *words: str) -> None:
        """Run a command beside the flight, which has to succeed."""
        done = self.net.run(DESK, [*SWARMCTL, *words, "--swarm", NAME], self.folder)
        assert done.returncode == 0, done.stdout + done.stderr

    def order(self, order: str) -> None:
        """Give an order to all vehicles."""
        self.swarmctl("order", order, "--all")

    def start(self, name: str, speedup: int = 1) -> None:
        """Start an autopilot, with its parameters in a fresh folder."""
        index = list(self.sysids).index(name)
        self.starts += 1
        folder = self.folder / f"{name}-{self.starts}"
        folder.mkdir()
        kind, vehicle = self.kinds[index], self.content["vehicles"][index]
        words = self._words(kind, vehicle, speedup, folder)
        self.autopilots[name] = self.net.start(DESK, words, folder / "out.log")

    def end(self, name: str) -> None:
        """End an autopilot at once, as by a loss of its power."""
        self.autopilots[name].kill()

    def await_position(self, names: Sequence[str]) -> None:
        """Wait until ArduPilots know where they are, and give them the machine's clock."""
        kinds = dict(zip(self.sysids, self.kinds, strict=True))
        for name in names:
            if kinds[name] == "px4":  # its clock is the machine's from the start
                continue
            sysid = self.sysids[name]
            self.witness.until(lambda w, s=sysid: w[s].has_position, f"position of {name}", POSITION_S)
            self.witness.set_parameter(sysid, "SIM_SPEEDUP", 1.0)

    def _words(self, kind: str, vehicle: dict[str, Any], speedup: int, folder: Path) -> list[str]:
        program = self.builds.programs[kind]
        place = (vehicle["start"]["lat_deg"], vehicle["start"]["lon_deg"])
        if kind == "px4":
            own = PX4_PARAMETERS | {"MPC_XY_CRUISE": vehicle["speed_m_s"]}
            return _px4(program, vehicle["sysid"] - 1, place, own, folder)
        port = self.relay.add(lambda p: self.net.udp_socket(DESK, p), STATION_PORT)
        settings = {
            "sysid": vehicle["sysid"],
            "speedup": speedup,
            "home": f"{place[0]},{place[1]},{GROUND_AMSL_M},90",
            "serial0": f"udpclient:127.0.0.1:{port}",
            "serial1": f"udpclient:127.0.0.1:{WITNESS_PORT}",
        }
        speed = {"WPNAV_SPEED": 100 * vehicle["speed_m_s"]}
        own = COPTER_PARAMETERS | speed if kind == "arducopter" else PLANE_PARAMETERS
        return _ardupilot(kind, program, settings, ARDUPILOT_PARAMETERS | own, folder)


def _ardupilot(
    kind: str, program: Path, settings: dict[str, Any], own: dict[str, float], folder: Path
) -> list[str]:
    tools = program.parents[3] / "Tools" / "autotest"
    shipped = {"arducopter": "default_params/copter.parm", "arduplane": "models/plane.parm"}[kind]
    (folder / "own.parm").write_text("".join(f"{name} {value}\n" for name, value in own.items()))
    settings["model"] = "quad" if kind == "arducopter" else "plane"
    settings["defaults"] = f"{tools / shipped},{folder / 'own.parm'}"
    words = [word for name, value in settings.items() for word in (f"--{name}", str(value))]
    return [str(program), f"-I{settings['sysid'] - 1}", *words]


def _px4(
    program: Path, instance: int, place: tuple[float, float], own: dict[str, float], folder: Path
) -> list[str]:
    lines = "".join(f"param set {name} {value}\n" for name, value in own.items())
    (folder / "px4-rc.params").write_text(lines)  # PX4's start looks for it on the path
    environment = {
        "PATH": f"{folder}:{os.environ['PATH']}",
        "PX4_SYS_AUTOSTART": "10040",
        "PX4_SIM_MODEL": "sihsim_quadx",
        "PX4_HOME_LAT": str(round(place[0] * 1e7)),
        "PX4_HOME_LON": str(round(place[1] * 1e7)),
    }
    settings = [f"{name}={value}" for name, value in environment.items()]
    return ["env", *settings, str(program), "-i", str(instance), "-d", str(program.parents[1] / "etc")]


@contextlib.contextmanager
def airfield(
    builds: Builds,
    folder: Path,
    kinds: Sequence[str],
    content: dict[str, Any],
    radio: Radio,
    keep: Callable[[str, object], None],
) -> Iterator[Airfield]:
    """Start the autopilots of a configuration, and end everything with the block."""
    with contextlib.ExitStack() as ends:
        net = ends.enter_context(bridged_network(BRIDGE))
        net.machine(DESK, ADDRESS, BRIDGE)
        relay, witness = Relay(radio), Witness(net.udp_socket(DESK, WITNESS_PORT))
        ends.callback(relay.close)
        ends.callback(witness.close)
        field = Airfield(net, builds, folder, content, kinds, witness, relay, keep)
        field.config.write_text(yaml.safe_dump(content, sort_keys=False))
        for name in field.sysids:
            field.start(name, BOOT_SPEEDUP)
        relay.start()
        field.await_position(list(field.sysids))
        yield field
