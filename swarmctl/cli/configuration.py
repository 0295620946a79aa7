"""Loading of configurations. An invalid configuration ends the command with a list of all problems."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from swarmctl.cli.console import FAILED, USAGE, err, fail
from swarmctl.config.examples import example
from swarmctl.config.problems import ConfigError, ConfigProblem, problem_lines
from swarmctl.config.roster import Roster, load_roster
from swarmctl.security.files import KeyringError

if TYPE_CHECKING:
    from swarmctl.config.model import Config
    from swarmctl.config.scenario import Scenario
    from swarmctl.config.yaml_lines import Document


def load_roster_or_exit(path: Path) -> Roster:
    """Return the roster of a configuration; exit with all problems if the roster is invalid."""
    try:
        return load_roster(path)
    except ConfigError as error:
        fail(error.lines, USAGE)


def config_or_example(config: Path | None, name: str | None) -> Path:
    """Return the file of --config or --example; exit unless exactly one of the options is given."""
    if config is not None and name is None:
        return config
    if config is not None or name is None:
        fail(["give either --config FILE or --example NAME, such as --example swarm"], USAGE)
    try:
        return example(name)
    except ValueError as error:
        fail([f"--example {error}"], USAGE)


def load_scenario_or_exit(path: Path) -> Scenario:
    """Return the scenario of a configuration; exit with all problems if the configuration is invalid."""
    from swarmctl.config.model import load  # noqa: PLC0415 - unused by commands that send
    from swarmctl.config.scenario import build  # noqa: PLC0415

    try:
        return build(load(path, _problems))
    except ConfigError as error:
        fail(error.lines, USAGE)


def describe(scenario: Scenario) -> str:
    """Return one line about a scenario: vehicles, area, announced number of hostiles."""
    n, grid = len(scenario.specs), scenario.grid
    return (
        f"{n} vehicle{'s' if n != 1 else ''}, {grid.rows} × {grid.cols} cells of {grid.cell_size_m:g} m, "
        f"{scenario.prior.count} hostiles expected"
    )


def _problems(config: Config) -> Iterable[ConfigProblem]:
    """Return the problems across the sections; for a large area, compile the planners first."""
    from swarmctl.cli import machine_code  # noqa: PLC0415
    from swarmctl.config.checks import check_config  # noqa: PLC0415

    machine_code.prepare(config, err)
    return check_config(config)


def require_flyable(path: Path, scenario: Scenario, runs: Path) -> None:
    """Exit with all problems that prevent a flight of this configuration on this machine now.

    `runs` is the parent of the run folders.
    """
    from swarmctl.config.model import read_document  # noqa: PLC0415

    if problems := flight_problems(path, read_document(path), scenario, runs):
        fail(problems, FAILED)


def flight_problems(
    path: Path, document: Document, scenario: Scenario, runs: Path, more: Iterable[str] = ()
) -> list[str]:
    """Return all problems of a flight on this machine now; `more` lists problems that the caller has found.

    A problem of one vehicle or of `links.signing_key` begins with the file and line.
    """
    from swarmctl.preflight import host  # noqa: PLC0415

    found = problem_lines(path, document, _signing_key_problems(scenario))
    lines = {spec.name: document.line_of(("simulate",)) for spec in scenario.specs}
    for i, vehicle in enumerate(scenario.config.vehicles):
        lines[vehicle.name] = document.line_of(("vehicles", i))
    for text in (*host.troubles(scenario, runs), *more):
        line = lines.get(text.split(":")[0])
        found.append(text if line is None else f"{path}:{line}: {text}")
    return found


def _signing_key_problems(scenario: Scenario) -> Iterator[ConfigProblem]:
    from swarmctl.security.mavlink_key import read_mavlink_key  # noqa: PLC0415

    if (file := scenario.config.links.signing_key) is not None:
        try:
            read_mavlink_key(Path(file))
        except KeyringError as error:
            yield ConfigProblem(("links", "signing_key"), str(error))


def fail_for_keys(path: Path | None, error: KeyringError) -> NoReturn:
    """Exit with an error of keys, at the line of the folder if a configuration names it."""
    from swarmctl.config.model import read_document  # noqa: PLC0415

    lines = [str(error)]
    fail(lines if path is None else keys_problem_lines(path, read_document(path), lines), FAILED)


def keys_problem_lines(path: Path, document: Document, problems: Iterable[str]) -> list[str]:
    """Return the problems of the folder `communication.keys`, each with the file and line that name it."""
    located = (ConfigProblem(("communication", "keys"), text) for text in problems)
    return problem_lines(path, document, located)
