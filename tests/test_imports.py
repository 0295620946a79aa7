"""Who may import whom, as data, held against the code."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

# Part of the tree -> the parts of this repository it may import. A part may always import itself.
MAY_IMPORT: dict[str, set[str]] = {
    "swarmctl.core": set(),
    "swarmctl.planners": {"swarmctl.core"},
    "swarmctl.sensors": {"swarmctl.core"},
    "swarmctl.mavlink": {"swarmctl.core"},
    "swarmctl.links": {"swarmctl.core", "swarmctl.mavlink"},
    "swarmctl.bus": {"swarmctl.core"},
    "swarmctl.picture": {"swarmctl.core"},
    "swarmctl.clock": set(),
    "swarmctl.garbage": set(),
    "swarmctl.supervise": set(),
    "swarmctl.yaml_lines": set(),
    "swarmctl.planfile": {"swarmctl.core"},
    "swarmctl.rules": {"swarmctl.core", "swarmctl.config_base"},
    "swarmctl.agent": {"swarmctl.core", "swarmctl.planners", "swarmctl.rules", "swarmctl.separation"},
    "swarmctl.separation": {"swarmctl.core"},
    "swarmctl.arrival_report": {"swarmctl.agent"},
    "swarmctl.swap_report": {"swarmctl.core"},
    "swarmctl.separation_report": {"swarmctl.core", "swarmctl.agent", "swarmctl.separation"},
    "swarmctl.config_separation": {"swarmctl.config_base"},
    "swarmctl.config_arrival": {"swarmctl.config_base"},
    "swarmctl.config_base": set(),
    "swarmctl.config_count": {"swarmctl.config_base"},
    "swarmctl.config_rules": {"swarmctl.config_base", "swarmctl.rules"},
    "swarmctl.config_links": {"swarmctl.config_base", "swarmctl.links.url"},
    "swarmctl.config_communication": {"swarmctl.config_base", "swarmctl.bus.endpoint"},
    "swarmctl.config_vehicles": {"swarmctl.config_base", "swarmctl.config_links", "swarmctl.core"},
    "swarmctl.config": {
        "swarmctl.config_vehicles",
        "swarmctl.config_base", "swarmctl.config_communication", "swarmctl.config_count",
        "swarmctl.config_links",
        "swarmctl.config_rules", "swarmctl.config_separation", "swarmctl.config_arrival",
        "swarmctl.config_preflight", "swarmctl.config_wings",
        "swarmctl.core", "swarmctl.planners", "swarmctl.links.url", "swarmctl.yaml_lines",
        "swarmctl.bus.keys",
    },
    "swarmctl.scenario": {
        "swarmctl.config_vehicles",
        "swarmctl.config_count", "swarmctl.config_rules", "swarmctl.rules", "swarmctl.separation",
        "swarmctl.preflight.fence",
        "swarmctl.core", "swarmctl.planners", "swarmctl.links.url", "swarmctl.yaml_lines", "swarmctl.config",
        "swarmctl.agent",
    },
    "swarmctl.judge": {
        "swarmctl.config_count",
        "swarmctl.core", "swarmctl.planners", "swarmctl.links.url", "swarmctl.yaml_lines", "swarmctl.config",
        "swarmctl.agent", "swarmctl.scenario", "swarmctl.judge_bounds", "swarmctl.judge_communication",
        "swarmctl.judge_separation", "swarmctl.judge_arrival", "swarmctl.judge_links",
        "swarmctl.judge_preflight", "swarmctl.judge_wings",
    },
    "swarmctl.judge_wings": {
        "swarmctl.agent", "swarmctl.config", "swarmctl.core", "swarmctl.planners", "swarmctl.scenario",
        "swarmctl.yaml_lines",
    },
    "swarmctl.config_wings": {"swarmctl.config_base"},
    "swarmctl.judge_arrival": {"swarmctl.config"},
    "swarmctl.judge_separation": {
        "swarmctl.agent", "swarmctl.config", "swarmctl.planners", "swarmctl.scenario", "swarmctl.separation",
    },
    "swarmctl.judge_communication": {
        "swarmctl.core", "swarmctl.yaml_lines", "swarmctl.config", "swarmctl.config_communication",
        "swarmctl.bus.endpoint", "swarmctl.bus.radio", "swarmctl.mesh",
    },
    "swarmctl.judge_links": {
        "swarmctl.config", "swarmctl.config_links", "swarmctl.links.forward", "swarmctl.links.url",
    },
    "swarmctl.judge_preflight": {"swarmctl.core", "swarmctl.yaml_lines", "swarmctl.config"},
    "swarmctl.mesh": {"swarmctl.core.roster", "swarmctl.bus.endpoint"},
    "swarmctl.roll": {
        "swarmctl.core", "swarmctl.yaml_lines", "swarmctl.config", "swarmctl.config_communication",
        "swarmctl.bus.keys", "swarmctl.judge", "swarmctl.mesh", "swarmctl.scenario",
    },
    "swarmctl.radio_settings": {
        "swarmctl.core", "swarmctl.config_communication", "swarmctl.bus.radio",
    },
    "swarmctl.judge_bounds": {
        "swarmctl.config_vehicles",
        "swarmctl.planners", "swarmctl.yaml_lines", "swarmctl.config", "swarmctl.agent",
    },
    "swarmctl.runner": {
        "swarmctl.core", "swarmctl.agent", "swarmctl.bus", "swarmctl.links", "swarmctl.supervise",
    },
    "swarmctl.left": {"swarmctl.core", "swarmctl.agent"},
    "swarmctl.record": {"swarmctl.core", "swarmctl.agent", "swarmctl.config", "swarmctl.scenario"},
    "swarmctl.known": {
        "swarmctl.core", "swarmctl.agent", "swarmctl.planners", "swarmctl.record", "swarmctl.scenario",
    },
    "swarmctl.summary": {
        "swarmctl.separation",
        "swarmctl.core", "swarmctl.planners", "swarmctl.agent", "swarmctl.scenario", "swarmctl.bus.tally",
        "swarmctl.separation_report", "swarmctl.arrival_report", "swarmctl.swap_report", "swarmctl.left",
    },
    "swarmctl.evidence": {"swarmctl.core", "swarmctl.mavlink", "swarmctl.agent"},
    "swarmctl.evidence_run": {
        "swarmctl.bus.access", "swarmctl.evidence", "swarmctl.keyring", "swarmctl.parts", "swarmctl.scenario",
    },
    "swarmctl.display": {"swarmctl.core", "swarmctl.agent", "swarmctl.left"},
    "swarmctl.member": {"swarmctl.agent", "swarmctl.links", "swarmctl.runner", "swarmctl.scenario"},
    "swarmctl.calling_off": {
        "swarmctl.core", "swarmctl.agent", "swarmctl.config", "swarmctl.left", "swarmctl.member",
    },
    "swarmctl.director": {
        "swarmctl.core", "swarmctl.agent", "swarmctl.config", "swarmctl.links", "swarmctl.runner",
        "swarmctl.left", "swarmctl.member", "swarmctl.calling_off", "swarmctl.scenario",
        "swarmctl.supervise",
    },
    "swarmctl.last_resort": {
        "swarmctl.core", "swarmctl.agent", "swarmctl.links", "swarmctl.calling_off", "swarmctl.member",
    },
    "swarmctl.networking": {
        "swarmctl.core", "swarmctl.bus", "swarmctl.radio_settings", "swarmctl.scenario",
    },
    "swarmctl.simulator": {
        "swarmctl.config_vehicles",
        "swarmctl.mavlink.firmware", "swarmctl.preflight.intent", "swarmctl.scenario", "swarmctl.supervise",
    },
    "swarmctl.virtual": {
        "swarmctl.links", "swarmctl.scenario", "swarmctl.simulator", "swarmctl.supervise", "sim_vehicle",
    },
    "swarmctl.config_preflight": {"swarmctl.config_base"},
    # What decides of preflight; what does I/O for it stands below.
    "swarmctl.preflight": {
        "swarmctl.core", "swarmctl.mavlink", "swarmctl.config_preflight", "swarmctl.scenario",
        "swarmctl.separation", "swarmctl.agent.approach", "swarmctl.agent.bounds",
        "swarmctl.agent.flight_path", "swarmctl.agent.pace",
    },
    "swarmctl.preflight.machine": {
        "swarmctl.links.packages",
        "swarmctl.links.url", "swarmctl.scenario", "swarmctl.config_communication", "swarmctl.bus.endpoint",
    },
    "swarmctl.preflight.conduct": {
        "swarmctl.preflight", "swarmctl.core", "swarmctl.mavlink", "swarmctl.links", "swarmctl.runner",
        "swarmctl.agent", "swarmctl.scenario", "swarmctl.separation",
    },
    "swarmctl.parts": {
        "swarmctl.core", "swarmctl.planners", "swarmctl.sensors", "swarmctl.links", "swarmctl.bus",
        "swarmctl.runner", "swarmctl.member", "swarmctl.scenario", "swarmctl.simulator", "swarmctl.virtual",
        "swarmctl.config_links", "swarmctl.keyring", "swarmctl.evidence",
    },
    "swarmctl.order_desk": {
        "swarmctl.calling_off", "swarmctl.member",
        "swarmctl.core", "swarmctl.bus", "swarmctl.director", "swarmctl.face", "swarmctl.scenario",
    },
    "swarmctl.taking_turns": {"swarmctl.agent", "swarmctl.core"},
    "swarmctl.showing": {
        "swarmctl.member",
        "swarmctl.bus", "swarmctl.director", "swarmctl.display", "swarmctl.face", "swarmctl.scenario",
        "swarmctl.summary",
    },
    "swarmctl.conducting": {
        "swarmctl.member",
        "swarmctl.director", "swarmctl.evidence", "swarmctl.face", "swarmctl.simulator", "swarmctl.supervise",
    },
    "swarmctl.app": {
        "swarmctl.calling_off", "swarmctl.member",
        "swarmctl.agent", "swarmctl.bus", "swarmctl.conducting", "swarmctl.core", "swarmctl.director",
        "swarmctl.evidence", "swarmctl.evidence_run", "swarmctl.face", "swarmctl.last_resort",
        "swarmctl.left", "swarmctl.links", "swarmctl.networking", "swarmctl.order_desk", "swarmctl.parts",
        "swarmctl.preflight", "swarmctl.record", "swarmctl.runner", "swarmctl.scenario",
        "swarmctl.separation", "swarmctl.showing", "swarmctl.simulator", "swarmctl.summary",
        "swarmctl.taking_turns",
        "swarmctl.virtual",
    },
    "swarmctl.companion": {
        "swarmctl.member",
        "swarmctl.core", "swarmctl.links.url", "swarmctl.bus", "swarmctl.app", "swarmctl.director",
        "swarmctl.face", "swarmctl.keyring", "swarmctl.parts", "swarmctl.scenario", "swarmctl.supervise",
        "swarmctl.virtual", "swarmctl.agent", "swarmctl.joining", "swarmctl.preflight.waivers",
    },
    "swarmctl.joining": {
        "swarmctl.bus", "swarmctl.config_communication", "swarmctl.keyring", "swarmctl.mesh",
    },
    "swarmctl.watch": {"swarmctl.core", "swarmctl.agent", "swarmctl.bus", "swarmctl.display"},
    "swarmctl.outputs": {
        "swarmctl.core", "swarmctl.planners", "swarmctl.agent", "swarmctl.app", "swarmctl.picture",
        "swarmctl.left", "swarmctl.planfile", "swarmctl.scenario", "swarmctl.summary",
    },
    "swarmctl.front_report": {
        "swarmctl.core", "swarmctl.planners", "swarmctl.agent", "swarmctl.figures", "swarmctl.picture",
        "swarmctl.scenario",
    },
    "swarmctl.plan_report": {
        "swarmctl.planners", "swarmctl.agent", "swarmctl.figures", "swarmctl.outputs", "swarmctl.scenario",
    },
    "swarmctl.flight_report": {"swarmctl.core", "swarmctl.figures", "swarmctl.swap_report"},
    "swarmctl.figures": set(),
    "swarmctl.answers": {"swarmctl.core"},
    "swarmctl.face": {"swarmctl.core", "swarmctl.agent", "swarmctl.answers", "swarmctl.display"},
    "swarmctl.terminal": {"swarmctl.agent", "swarmctl.display", "swarmctl.face"},
    "swarmctl.keyring": {"swarmctl.bus.access", "swarmctl.bus.zenoh_config", "swarmctl.core.signing_key"},
    "swarmctl.router": {"swarmctl.bus"},
    "swarmctl.calling_back": {"swarmctl.core", "swarmctl.bus", "swarmctl.operate"},
    "swarmctl.operate": {"swarmctl.core", "swarmctl.bus", "swarmctl.joining"},
    "swarmctl.commands": {"swarmctl"},
    "swarmctl.cli": {"swarmctl.commands", "swarmctl.bus.leaving"},
    "swarmctl.entry": {"swarmctl.cli"},
    "sim_vehicle": set(),
    "sim_vehicle.physics": set(),
    "sim_vehicle.wire": {"sim_vehicle.physics", "sim_vehicle.epoch", "sim_vehicle.personalities.base"},
    "sim_vehicle.files": {
        "sim_vehicle.physics", "sim_vehicle.wire", "sim_vehicle.epoch", "sim_vehicle.vehicle.mission",
    },
    "sim_vehicle.vehicle": {
        "sim_vehicle.physics", "sim_vehicle.wire", "sim_vehicle.files", "sim_vehicle.personalities.base",
        "sim_vehicle.faults", "sim_vehicle.epoch",
    },
    "sim_vehicle.faults": {
        "sim_vehicle.vehicle.afflictions", "sim_vehicle.wire", "sim_vehicle.ranges", "sim_vehicle.epoch",
    },
    "sim_vehicle.links": {"sim_vehicle.url"},
    # It judges autopilots, so it must not know how the simulated ones are made.
    "sim_vehicle.conformance": {"sim_vehicle.url"},
}  # fmt: skip

VERSION = {"swarmctl.__version__"}

# Package of others -> the only parts that may import it.
ONLY_IN: dict[str, set[str]] = {
    "zenoh": {"swarmctl.bus.zenoh_bus"},
    "cryptography": {"swarmctl.keyring"},
    "mavsdk": {"swarmctl.links.mavsdk"},
    "numba": {"swarmctl.planners.kernels"},
    "pymavlink": {"swarmctl.mavlink", "sim_vehicle"},
    "serial": {"swarmctl.links.serial", "sim_vehicle.links.serial", "sim_vehicle.conformance.sockets"},
    "socket": {
        "swarmctl.links",
        "swarmctl.parts",
        "swarmctl.preflight.machine",
        "sim_vehicle.links",
        "sim_vehicle.conformance.sockets",
        "sim_vehicle.testing.served",
    },
    "matplotlib": {"swarmctl.picture"},
    "mcap": {"swarmctl.record"},
    "typer": {
        "swarmctl.cli",
        "swarmctl.commands",
        "sim_vehicle.__main__",
        "sim_vehicle.serving.serve",
        "sim_vehicle.run.command",
        "sim_vehicle.conformance.cli",
    },
    "pytest": {"sim_vehicle.pytest_plugin"},
    "yaml": {"swarmctl.yaml_lines", "sim_vehicle.yaml_lines"},
}

# What nothing pure may import: the parts that only decide take time, randomness and bytes as arguments.
PURE = {
    "swarmctl.core", "swarmctl.planners", "swarmctl.mavlink", "swarmctl.agent", "swarmctl.sensors",
    "swarmctl.rules", "swarmctl.separation", "swarmctl.preflight.checks", "swarmctl.preflight.policy",
    "swarmctl.preflight.facts", "swarmctl.preflight.fence", "swarmctl.preflight.intent",
    "swarmctl.preflight.waivers",
    "swarmctl.evidence.chain", "swarmctl.evidence.traffic", "swarmctl.evidence.story",
    "swarmctl.evidence.digest",
    "swarmctl.bus.radio", "swarmctl.bus.access", "swarmctl.bus.endpoint", "swarmctl.bus.zenoh_config",
    "sim_vehicle",
}  # fmt: skip
# The simulator's only sockets, clocks, tasks and processes.
SHELLS = {
    "sim_vehicle.__main__", "sim_vehicle.links", "sim_vehicle.pytest_plugin",
    "sim_vehicle.serving.serve", "sim_vehicle.serving.server", "sim_vehicle.serving.pace",
    "sim_vehicle.serving.hand", "sim_vehicle.serving.display",
    "sim_vehicle.run.command", "sim_vehicle.testing.served", "sim_vehicle.conformance.sockets",
}  # fmt: skip
IMPURE = {"time", "random", "asyncio", "socket", "threading", "subprocess", "os", "datetime"}

MODULES = sorted(path for package in ("swarmctl", "sim_vehicle") for path in (ROOT / package).rglob("*.py"))


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import hides what is imported"
            assert node.module is not None
            found |= {
                f"{node.module}.{a.name}" if (ROOT / node.module.replace(".", "/")).is_dir() else node.module
                for a in node.names
            }
    return found


def within(module: str, parts: set[str]) -> bool:
    return any(module == part or module.startswith(f"{part}.") for part in parts)


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_module_imports_only_what_the_table_allows(path: Path) -> None:
    module = name_of(path)
    if module == "swarmctl":
        return
    parts = [part for part in MAY_IMPORT if within(module, {part})]
    assert parts, f"{module} is in no part of the table"
    part = max(parts, key=len)
    ours = {name for name in imports(path) if within(name, {"swarmctl", "sim_vehicle"})}
    wrong = {name for name in ours - VERSION if not within(name, {part} | MAY_IMPORT[part])}
    assert not wrong, f"{module} must not import {sorted(wrong)}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_foreign_package_is_imported_only_where_it_belongs(path: Path) -> None:
    module = name_of(path)
    for package, parts in ONLY_IN.items():
        if any(within(name, {package}) for name in imports(path)):
            assert within(module, parts), f"{module} must not import {package}"


@pytest.mark.parametrize(
    "path", [p for p in MODULES if within(name_of(p), PURE) and not within(name_of(p), SHELLS)], ids=name_of
)
def test_what_decides_reads_no_clock_and_does_no_io(path: Path) -> None:
    assert not {name.split(".")[0] for name in imports(path)} & IMPURE
