"""Start of the program: packages that a command loads, `python -m swarmctl`, and shell completion."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from swarmctl.cli.main import cli, load_command
from swarmctl.cli.registry import COMMANDS

HEAVY = {"numpy", "scipy", "numba", "matplotlib", "zenoh", "pydantic", "pymavlink", "cryptography", "mcap"}
LOADED = "import sys; from swarmctl.cli.main import cli\ntry: cli({words!r})\nexcept SystemExit: pass\n"
LOADED += "print('loaded', *sorted({heavy!r} & set(sys.modules)))"


def loaded(*words: str) -> set[str]:
    code = LOADED.format(words=words, heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize("words", [["--help"], ["--version"], []], ids=["help", "version", "nothing"])
def test_help_and_version_load_no_heavy_package(words: list[str]) -> None:
    assert loaded(*words) == set()


@pytest.mark.full
@pytest.mark.parametrize("command", ["order", "set", "observe", "abort", "router", "keys"])
def test_a_command_without_a_plan_loads_neither_planners_nor_pictures(command: str) -> None:
    assert not loaded(command, "--help") & {"scipy", "numba", "matplotlib", "pymavlink", "mcap"}


def test_a_ground_station_loads_no_pictures_and_no_recorder() -> None:
    assert not loaded("watch", "--help") & {"matplotlib", "mcap"}


def test_a_check_loads_no_network_and_no_pictures() -> None:
    heavy = {"zenoh", "numba", "matplotlib", "mcap"}
    assert not loaded("check", "--config", "configs/swarm.yaml", "--out", "runs") & heavy


def module(*words: str, **environment: str) -> str:
    command = [sys.executable, "-m", "swarmctl", *words]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment, check=True)
    return done.stdout


def test_the_module_has_the_name_of_the_program() -> None:
    assert "Usage: swarmctl " in module("--help")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("swarmctl ab", {"abort"}),
        ("swarmctl order l", {"launch", "land"}),
        ("swarmctl order launch --i", {"--ignore"}),
        ("swarmctl fly --cl", {"--clock"}),
        ("swarmctl study --sc", {"--scheduler"}),
        ("swarmctl fly --clock v", {"virtual"}),
    ],
)
def test_the_shell_completes_commands_options_and_values(line: str, expected: set[str]) -> None:
    position = str(len(line.split()) - 1)
    environment = {"_SWARMCTL_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": position}
    output = CliRunner().invoke(cli, [], env=environment, prog_name="swarmctl").stdout
    assert set(output.split()) == expected


def test_the_completion_of_a_shell_is_printed() -> None:
    # Typer looks for a shell among the parents of the process, and a test may run without one.
    without_detection = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    assert "_SWARMCTL_COMPLETE" in module("--show-completion", "bash", **without_detection)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_summary_is_the_first_paragraph_of_the_commands_help(name: str) -> None:
    _, summary = COMMANDS[name]
    command = load_command(name)
    assert command.name == name
    assert " ".join(command.help.split("\n\n")[0].split()) == summary


def test_an_unknown_command_is_an_error_with_similar_names() -> None:
    result = CliRunner().invoke(cli, ["oder"])
    assert result.exit_code == 2
    assert "No such command 'oder'" in result.stderr
    assert "order" in result.stderr
