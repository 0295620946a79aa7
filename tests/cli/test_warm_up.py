"""Machine code for large areas: a separate process compiles it, and small areas need none."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console
from swarmctl_process import SWARMCTL, CliFlight, fly

from swarmctl.cli import machine_code
from swarmctl.config.model import Config

SMALL, LARGE = 20, 1000
"""rows and columns of an area"""


def configured(side: int, benevolence: float = 0.0) -> Config:
    content = {
        "area": {
            "origin_lat_deg": 46.0,
            "origin_lon_deg": 14.0,
            "rows": side,
            "cols": side,
            "cell_size_m": 50,
        },
        "threats": {"count": 5},
        "planner": {"benevolence": benevolence},
        "simulate": {"count": 2},
    }
    return Config.model_validate_json(json.dumps(content))


def console(*, terminal: bool = False) -> Console:
    return Console(file=io.StringIO(), force_terminal=terminal, width=140)


def printed(on: Console) -> str:
    assert isinstance(on.file, io.StringIO)
    return on.file.getvalue()


def compiler(program: str) -> list[str]:
    """Return the command of a process in place of the compiler."""
    return [sys.executable, "-c", program]


THREE_STEPS = compiler("for done in range(4): print(done, 3, flush=True)")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for machine code."""
    monkeypatch.setattr(machine_code, "numba_cache", lambda: (tmp_path, "key"))
    return tmp_path


@pytest.mark.usefixtures("cache")
def test_a_small_area_needs_no_machine_code() -> None:
    on = console()
    machine_code.prepare(configured(SMALL), on)
    assert printed(on) == ""
    assert not machine_code.ready_file().exists()


@pytest.mark.parametrize("config", [configured(LARGE), configured(SMALL, benevolence=0.5)])
def test_each_step_is_a_line_and_the_second_time_nothing_is_compiled(
    cache: Path, monkeypatch: pytest.MonkeyPatch, config: Config
) -> None:
    on = console()
    monkeypatch.setattr(machine_code.compile_all, "__defaults__", (THREE_STEPS,))
    machine_code.prepare(config, on)
    assert [f"{done} of 3" in printed(on) for done in range(4)] == [True] * 4
    assert machine_code.ready_file().exists()
    monkeypatch.setattr(machine_code.compile_all, "__defaults__", (compiler("raise SystemExit(1)"),))
    again = console()
    machine_code.prepare(config, again)
    assert printed(again) == ""
    monkeypatch.setattr(machine_code, "numba_cache", lambda: (cache, "another machine"))
    assert not machine_code.ready_file().exists()


@pytest.mark.usefixtures("cache")
def test_a_terminal_shows_a_progress_bar() -> None:
    on = console(terminal=True)
    machine_code.compile_all(on, THREE_STEPS)
    assert "3/3" in printed(on)
    assert "\x1b" in printed(on)


@pytest.mark.usefixtures("cache")
def test_a_compiler_that_fails_is_an_error_and_leaves_nothing_ready() -> None:
    with pytest.raises(machine_code.CompilerError, match="7"):
        machine_code.compile_all(console(), compiler("print(0, 2); raise SystemExit(7)"))
    assert not machine_code.ready_file().exists()


def test_a_machine_without_a_folder_for_machine_code_gets_advice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(machine_code, "numba_cache", lambda: None)
    on = console()
    machine_code.prepare(configured(LARGE), on)
    assert "NUMBA_CACHE_DIR" in printed(on)


@pytest.mark.full
def test_warm_up_names_the_folder_and_compiles_once() -> None:
    first, second = (
        subprocess.run([*SWARMCTL, "warm-up"], check=False, capture_output=True, text=True, timeout=300)
        for _ in range(2)
    )
    assert (first.returncode, second.returncode) == (0, 0), first.stderr + second.stderr
    folder = Path(second.stdout.strip().split(": ")[1])
    assert folder.is_dir()
    assert str(folder) in first.stdout
    assert len(second.stdout.splitlines()) == 1


@pytest.mark.virtual
def test_a_flight_over_a_small_area_loads_no_compiler(small_flight: CliFlight) -> None:
    assert small_flight.compilers == []


@pytest.mark.full
@pytest.mark.virtual
def test_the_shipped_example_flies_without_a_compiler(tmp_path: Path) -> None:
    flown = fly(tmp_path, "--example", "swarm")
    assert "5 of 5 arrived" in flown.output
    assert flown.compilers == []
