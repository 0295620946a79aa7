"""What commands that fly or plan have in common: the configuration, judged whole."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from swarmctl.cli import machine_code
from swarmctl.cli.console import EXPECTED, USAGE, err, fail
from swarmctl.config import yaml_lines
from swarmctl.config.checks import check_config
from swarmctl.config.model import Config, ConfigError, ConfigProblem, load, problem_lines
from swarmctl.config.scenario import Scenario, build
from swarmctl.preflight import host
from swarmctl.security.files import KeyringError
from swarmctl.security.mavlink_key import read_mavlink_key


def scenario_of(path: Path) -> Scenario:
    """What a configuration describes; leaves with everything that is wrong with it."""
    try:
        return build(load(path, _checked))
    except ConfigError as error:
        fail(error.lines, USAGE)


def _checked(config: Config) -> Iterable[ConfigProblem]:
    """Check a configuration across its sections; routes over a large area are planned by machine code."""
    machine_code.prepare(config.area.rows * config.area.cols, err)
    return check_config(config)


def require_fit(path: Path, scenario: Scenario, runs: Path, more: Iterable[str] = ()) -> None:
    """Leaves with what would stop a flight of this configuration here and now, each with where in the file
    it comes from; `more` is what the caller has found besides."""
    document = yaml_lines.parse(path.read_text(encoding="utf-8"))
    wrong_key = problem_lines(path, document, _signing_key(scenario))
    lines = {
        vehicle.name: document.line_of(("vehicles", i)) for i, vehicle in enumerate(scenario.config.vehicles)
    }
    found = [*wrong_key]
    for text in (*host.troubles(scenario, runs), *more):
        line = lines.get(text.split(":")[0])
        found.append(text if line is None else f"{path}:{line}: {text}")
    if found:
        fail(found, USAGE if wrong_key else EXPECTED)


def _signing_key(scenario: Scenario) -> Iterator[ConfigProblem]:
    if (file := scenario.config.links.signing_key) is not None:
        try:
            read_mavlink_key(Path(file))
        except KeyringError as error:
            yield ConfigProblem(("links", "signing_key"), str(error))
