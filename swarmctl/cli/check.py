"""`swarmctl check`: problems of a configuration."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from pathlib import Path

from swarmctl.bus.transports.access import OPERATOR, ROUTER, name_of
from swarmctl.cli.configuration import (
    config_or_example,
    describe,
    flight_problems,
    keys_problem_lines,
    load_scenario_or_exit,
)
from swarmctl.cli.console import FAILED, ConfigOrExampleOption, ExampleOption, OutOption, fail, say
from swarmctl.config.model import read_document
from swarmctl.config.scenario import Scenario
from swarmctl.config.yaml_lines import Document
from swarmctl.preflight.checks import battery


def check(
    config: ConfigOrExampleOption = None, example: ExampleOption = None, out_folder: OutOption = Path("runs")
) -> None:
    """Check a configuration and this machine, and list the problems, without a flight."""
    config = config_or_example(config, example)
    scenario = load_scenario_or_exit(config)
    if problems := problems_of(config, read_document(config), scenario, out_folder):
        fail(problems, FAILED)
    say(f"{config}: no problems. {describe(scenario)}")
    real = [spec.name for spec in scenario.specs if not spec.simulated]
    if real and scenario.config.preflight.endurance_s is None:
        text = f"set preflight.endurance_s: without it the check `battery` fails for {', '.join(real)}"
        say(f"{text}, unless the built-in simulator flies them")


def problems_of(path: Path, document: Document, scenario: Scenario, out_folder: Path) -> list[str]:
    """Return the problems that `check` lists for a valid configuration, of which `document` is the text."""
    problems = [*keys_problem_lines(path, document, _key_problems(scenario)), *battery.problems(scenario)]
    return flight_problems(path, document, scenario, out_folder, problems)


def _key_problems(scenario: Scenario) -> Iterator[str]:
    """Yield the problems of all participants' keys, if `communication.keys` names their folder."""
    communication = scenario.config.communication
    if communication.keys is None:
        return
    from swarmctl.security.participant import find_problems  # noqa: PLC0415 - loads cryptography

    names = [name_of(uav) for uav in scenario.config.names] + [OPERATOR]
    names += [ROUTER] if communication.router is not None else []
    yield from find_problems(Path(communication.keys), names, dt.datetime.now(dt.UTC))
