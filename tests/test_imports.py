"""Import rules as data, compared with the code: one row for each room."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent

# Room -> the rooms of this repository it may import, besides itself. Lower rooms come first.
ROOMS: dict[str, set[str]] = {
    "swarmctl.core": set(),
    "swarmctl.planners": {"core"},
    "swarmctl.mavlink": {"core"},
    "swarmctl.sensors": {"core"},
    "swarmctl.bus": {"core"},
    "swarmctl.links": {"core", "mavlink"},
    "swarmctl.security": {"core", "bus"},
    "swarmctl.agent": {"core", "planners"},
    "swarmctl.config": {"core", "planners", "sensors", "mavlink", "bus", "links", "security", "agent"},
    "swarmctl.preflight": {"core", "mavlink", "bus", "links", "agent", "config"},
    "swarmctl.report": {"core", "planners", "mavlink", "bus", "agent", "config", "preflight"},
    "swarmctl.study": {"core", "planners", "sensors", "bus", "agent", "config", "report"},
    "swarmctl.station": {"core", "bus", "agent", "config", "report"},
    "swarmctl.dashboard": {
        "core", "planners", "sensors", "bus", "security", "agent", "config", "preflight", "report", "station",
        "study",
    },
    "swarmctl.flight": {
        "core", "planners", "sensors", "mavlink", "bus", "links", "security", "agent", "config", "preflight",
        "report",
    },
    "swarmctl.cli": {
        "core", "planners", "bus", "links", "security", "config", "preflight", "report", "station", "flight",
        "study", "dashboard",
    },
    "swarmctl.__main__": {"cli"},
    "sim_vehicle": set(),
}  # fmt: skip

# Module -> additional rooms that only this module may import.
ALONE: dict[str, set[str]] = {
    # The one file in which both packages meet: the simulator on the virtual clock.
    "swarmctl.flight.virtual_simulator": {"sim_vehicle"},
    # The one kind of experiment that has whole flights.
    "swarmctl.study.flights": {"swarmctl.flight"},
}

# Rooms of the simulator, by the same rule.
SIMULATOR: dict[str, set[str]] = {
    "sim_vehicle.physics": set(),
    "sim_vehicle.definitions": set(),
    "sim_vehicle.wire": {"physics", "definitions", "epoch"},
    "sim_vehicle.files": {"physics", "definitions", "wire", "epoch", "vehicle.mission"},
    "sim_vehicle.vehicle": {
        "physics",
        "definitions",
        "wire",
        "files",
        "personalities.base",
        "faults",
        "epoch",
    },
    "sim_vehicle.faults": {"vehicle.injected_faults", "wire", "ranges", "epoch", "problems"},
    "sim_vehicle.links": set(),
    # The conformance suite and its client fit any autopilot, so they must not depend on the simulated ones.
    "sim_vehicle.conformance": {"links", "station", "definitions"},
    "sim_vehicle.station": {"definitions", "epoch"},
}

# Foreign package -> the only modules that may import it.
ONLY_IN: dict[str, set[str]] = {
    "zenoh": {"swarmctl.bus.transports.zenoh"},
    "cryptography": {"swarmctl.security"},
    "distributed": {"swarmctl.study.cluster"},
    "mavsdk": {"swarmctl.links.mavsdk"},
    "numba": {"swarmctl.planners.kernels"},
    "pymavlink": {"swarmctl.mavlink", "sim_vehicle"},
    "serial": {"swarmctl.links.transports.serial", "sim_vehicle.links.serial"},
    "socket": {
        "swarmctl.links",
        "swarmctl.dashboard.server",
        "swarmctl.flight.run",
        "swarmctl.preflight.host",
        "sim_vehicle.links",
        "sim_vehicle.testing.served",
    },
    "matplotlib": {"swarmctl.report.pictures", "swarmctl.study.figures"},
    "mcap": {"swarmctl.report.record", "swarmctl.report.record_file"},
    "typer": {
        "swarmctl.cli",
        "sim_vehicle.__main__",
        "sim_vehicle.serving.serve",
        "sim_vehicle.scenarios.command",
        "sim_vehicle.conformance.cli",
        "sim_vehicle.conformance.table",
    },
    "pytest": {"sim_vehicle.pytest_plugin"},
    "ruamel.yaml": {"swarmctl.dashboard.draft"},
    "yaml": {"swarmctl.config.yaml_lines", "sim_vehicle.scenarios.yaml_lines"},
}  # fmt: skip

# Time, randomness and bytes are arguments here. A module that calls itself pure belongs to this list.
PURE = {
    "swarmctl.core", "swarmctl.planners", "swarmctl.sensors", "swarmctl.mavlink", "swarmctl.agent",
    "swarmctl.bus.node", "swarmctl.bus.radio", "swarmctl.bus.backlog", "swarmctl.bus.endpoint",
    "swarmctl.bus.keys", "swarmctl.bus.rate", "swarmctl.bus.sensor_reports",
    "swarmctl.bus.transports.access", "swarmctl.bus.transports.renewal",
    "swarmctl.bus.transports.zenoh_config",
    "swarmctl.config.arrival_checks", "swarmctl.config.autopilots", "swarmctl.config.checks",
    "swarmctl.config.communication_checks",
    "swarmctl.config.fence", "swarmctl.config.formations_checks", "swarmctl.config.links_checks",
    "swarmctl.config.preflight_checks",
    "swarmctl.config.radio", "swarmctl.config.scenario", "swarmctl.config.separation_checks",
    "swarmctl.config.specs", "swarmctl.config.wings_checks",
    "swarmctl.links.mavsdk_conversations", "swarmctl.links.url",
    "swarmctl.flight.network",
    "swarmctl.preflight.checks", "swarmctl.preflight.policy", "swarmctl.preflight.facts",
    "swarmctl.preflight.declared", "swarmctl.preflight.inspection", "swarmctl.preflight.results",
    "swarmctl.preflight.waivers",
    "swarmctl.study.compiled_mission", "swarmctl.study.kernel_layout", "swarmctl.study.message_kernels",
    "swarmctl.study.mission", "swarmctl.study.mission_kernels", "swarmctl.study.replan_kernels",
    "swarmctl.study.tables", "swarmctl.study.vehicle_result", "swarmctl.study.entered_cells",
    "swarmctl.study.world",
    "swarmctl.report.foxglove", "swarmctl.report.evidence.chain", "swarmctl.report.evidence.digest",
    "swarmctl.report.evidence.commands",
    "swarmctl.dashboard.belief_history", "swarmctl.dashboard.changes", "swarmctl.dashboard.conflicts",
    "swarmctl.dashboard.access", "swarmctl.dashboard.announced",
    "swarmctl.dashboard.events", "swarmctl.dashboard.facts", "swarmctl.dashboard.history",
    "swarmctl.dashboard.picture_parts", "swarmctl.dashboard.model", "swarmctl.dashboard.motions",
    "swarmctl.dashboard.picture",
    "swarmctl.dashboard.setup_edits", "swarmctl.dashboard.sources.mission", "swarmctl.dashboard.what_if",
    "swarmctl.dashboard.sources.record_facts",
    "swarmctl.study.batches", "swarmctl.study.experiment_checks", "swarmctl.study.levels",
    "swarmctl.study.statistics", "swarmctl.study.routes", "swarmctl.study.w_search",
    "sim_vehicle",
}  # fmt: skip
# The simulator's only sockets, clocks, tasks and processes.
SHELLS = {
    "sim_vehicle.__main__", "sim_vehicle.links", "sim_vehicle.pytest_plugin",
    "sim_vehicle.serving.serve", "sim_vehicle.serving.server", "sim_vehicle.serving.pace",
    "sim_vehicle.serving.manual_clock", "sim_vehicle.serving.display",
    "sim_vehicle.scenarios.command", "sim_vehicle.testing.served", "sim_vehicle.conformance.link_wire",
    # The only module below all rooms that write files.
    "swarmctl.core.whole_file",
}  # fmt: skip
IMPURE = {"time", "random", "asyncio", "socket", "threading", "subprocess", "os", "datetime"}

PATHS = sorted(path for package in ("swarmctl", "sim_vehicle") for path in (ROOT / package).rglob("*.py"))


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in PATHS}


@cache
def imports(module: str) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: a relative import hides what is imported"
            assert node.module is not None
            names = {f"{node.module}.{a.name}" for a in node.names}
            found |= {name if name in MODULES else node.module for name in names}
    return found


def within(module: str, parts: set[str]) -> bool:
    return any(module == part or module.startswith(f"{part}.") for part in parts)


def row_of(module: str, table: dict[str, set[str]]) -> str | None:
    return max((room for room in table if within(module, {room})), key=len, default=None)


def test_a_module_imports_only_what_the_row_of_its_room_allows() -> None:
    wrong = {}
    for module in MODULES.keys() - {"swarmctl"}:
        room = row_of(module, ROOMS)
        assert room is not None, f"{module} is in no room of the table"
        allowed = {room, *(f"swarmctl.{other}" for other in ROOMS[room])} | ALONE.get(module, set())
        if part := row_of(module, SIMULATOR):
            allowed = {part, *(f"sim_vehicle.{other}" for other in SIMULATOR[part])}
        ours = {name for name in imports(module) if within(name, {"swarmctl", "sim_vehicle"})} - {"swarmctl"}
        wrong[module] = {name for name in ours if not within(name, allowed)}
    assert {module: names for module, names in wrong.items() if names} == {}


def test_no_room_imports_a_room_above_it() -> None:
    above: set[str] = set()
    for room, below in reversed(ROOMS.items()):
        assert not {f"swarmctl.{other}" for other in below} & above, f"{room} imports a room above it"
        above.add(room)


def test_a_foreign_package_is_imported_only_by_the_modules_of_its_row() -> None:
    wrong = [
        (module, package)
        for package, parts in ONLY_IN.items()
        for module in MODULES
        if any(within(name, {package}) for name in imports(module)) and not within(module, parts)
    ]
    assert wrong == []


def test_a_pure_module_reads_no_clock_and_does_no_io() -> None:
    pure = [name for name in MODULES if within(name, PURE) and not within(name, SHELLS)]
    impure = {module: {name.split(".")[0] for name in imports(module)} & IMPURE for module in pure}
    assert {module: names for module, names in impure.items() if names} == {}


def test_a_module_with_pure_in_its_docstring_is_in_the_list_of_pure_modules() -> None:
    pure = {
        name for name in MODULES if "Pure." in (ast.get_docstring(ast.parse(MODULES[name].read_text())) or "")
    }
    assert {name for name in pure if not within(name, PURE)} == set()


def test_every_name_of_the_tables_is_a_module() -> None:
    named = {
        *ROOMS,
        *SIMULATOR,
        *PURE,
        *SHELLS,
        *ALONE,
        *(part for parts in ONLY_IN.values() for part in parts),
    }
    assert named - MODULES.keys() == set()


def test_every_module_at_the_top_belongs_to_a_room() -> None:
    loose = {path.name for path in (ROOT / "swarmctl").glob("*.py")}
    assert loose <= {"__init__.py", "__main__.py"}
