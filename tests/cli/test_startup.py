"""What a command loads: an order to an aircraft does not wait for pictures and planners."""

from __future__ import annotations

import inspect
import subprocess
import sys
from importlib import import_module

import pytest
import typer
from typer.testing import CliRunner

from swarmctl.cli.main import cli
from swarmctl.cli.registry import COMMANDS

HEAVY = {"numpy", "scipy", "numba", "matplotlib", "zenoh", "pydantic", "pymavlink", "cryptography", "mcap"}
LOADED = "import sys; from swarmctl.cli.main import cli\ntry: cli({words!r})\nexcept SystemExit: pass\n"
LOADED += "print('loaded', *sorted({heavy!r} & set(sys.modules)))"


def loaded(*words: str) -> set[str]:
    code = LOADED.format(words=words, heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split()[1:])


@pytest.mark.parametrize("words", [["--help"], ["--version"], []], ids=["help", "version", "nothing"])
def test_what_asks_about_the_program_itself_loads_nothing_of_it(words: list[str]) -> None:
    assert loaded(*words) == set()


@pytest.mark.parametrize("command", ["order", "set", "observe", "router", "keys"])
def test_who_neither_plans_nor_flies_loads_neither_planners_nor_pictures(command: str) -> None:
    assert not loaded(command, "--help") & {"scipy", "numba", "matplotlib", "pymavlink", "mcap"}


def test_a_ground_station_loads_no_pictures_and_no_recorder() -> None:
    assert not loaded("watch", "--help") & {"matplotlib", "mcap"}


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_all_says_of_a_command_what_its_own_help_begins_with(name: str) -> None:
    module, summary = COMMANDS[name]
    app = typer.Typer()
    import_module(f"swarmctl.cli.{module}").register(app)
    (command,) = app.registered_commands
    assert command.callback is not None
    assert (command.name or command.callback.__name__) == name
    own = inspect.getdoc(command.callback) or ""
    assert " ".join(own.split("\n\n")[0].split()) == summary


def test_what_is_no_command_is_said_with_what_may_be_meant() -> None:
    result = CliRunner().invoke(cli, ["oder"])
    assert result.exit_code == 2
    assert "No such command 'oder'" in result.stderr
    assert "order" in result.stderr
