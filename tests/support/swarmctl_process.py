"""The program: its command line in this process, or the program as a process of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.testing import CliRunner, Result

from swarmctl.cli.main import cli

ROOT = Path(__file__).parents[2]
SHIPPED = ROOT / "configs" / "swarm.yaml"
PROGRAM = "from swarmctl.cli.entry import main; main()"
SWARMCTL = [sys.executable, "-c", PROGRAM]


def swarmctl(*words: str | Path) -> Result:
    """Run the command line in this process."""
    return CliRunner().invoke(cli, [str(word) for word in words])


# -- a process ---------------------------------------------------------------------------------------------


def run(
    *words: str | Path,
    cwd: Path | None,
    timeout_s: float = 90.0,
    env: Mapping[str, str] | None = None,
    program: str = PROGRAM,
) -> subprocess.CompletedProcess[str]:
    """Run the program to its end; `program`: Python code that starts it in another way."""
    command = [sys.executable, "-c", program, *map(str, words)]
    return subprocess.run(
        command, cwd=cwd, env=env, timeout=timeout_s, capture_output=True, text=True, check=False
    )


@contextmanager
def started(
    *words: str | Path, cwd: Path | None, env: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[str]]:
    """Run the program during the block, with errors in its output, and kill it at the end."""
    command = [*SWARMCTL, *map(str, words)]
    with subprocess.Popen(
        command, cwd=cwd, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def read_until(process: subprocess.Popen[str], text: str) -> list[str]:
    assert process.stdout is not None
    lines: list[str] = []
    for line in process.stdout:
        lines.append(line.rstrip())
        if text in line:
            return lines
    raise AssertionError(f"it ended without saying {text!r}:\n" + "\n".join(lines))


# -- a flight by the command line, for all tests that read its files -----------------------------------------

SMALL = """\
name: small
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
simulate: {count: 2, ready_s: 3.0}
"""
NAMES_COMPILERS = (
    "import sys\nfrom swarmctl.cli.main import cli\n"
    "try: cli(sys.argv[1:])\nexcept SystemExit as ended: assert not ended.code, ended.code\n"
    "print(*(name for name in ('numba', 'llvmlite') if name in sys.modules))"
)


@dataclass(frozen=True, slots=True)
class CliFlight:
    run: Path
    """run folder"""
    output: str
    compilers: list[str]
    """modules of the compiler that the process has loaded"""


def fly(folder: Path, *words: str | Path) -> CliFlight:
    """Fly on the virtual clock; `words` select the configuration."""
    out = folder / "runs"
    words = ("fly", "--clock", "virtual", "--out", out, *words)
    done = run(*words, cwd=None, timeout_s=300.0, program=NAMES_COMPILERS)
    assert done.returncode == 0, done.stdout + done.stderr
    (run_folder,) = out.iterdir()
    *lines, compilers = done.stdout.splitlines()
    return CliFlight(run_folder, "\n".join(lines), compilers.split())


# -- a command with a dashboard ------------------------------------------------------------------------------

StartDashboard = Callable[..., subprocess.Popen[str]]
"""from the words of a command, and `cwd`, to its process"""


def address_of(process: subprocess.Popen[str]) -> str:
    """Wait until a process prints the address of its dashboard, and return it."""
    (address,) = addresses_of(process, 1)
    return address


def addresses_of(process: subprocess.Popen[str], n: int) -> list[str]:
    """Wait until a process prints several addresses of its dashboard, and return them."""
    return [re.findall(r"https?://\S+", read_until(process, "token=")[-1])[0] for _ in range(n)]


def await_facts(card: Any, cells: int, facts: Mapping[str, Any]) -> None:
    """Wait until a vehicle's card shows its known cells, and the facts of its summary or result."""
    card.filter(has_text=f"known cells: {cells}, known hostiles: {facts['hostiles_known']}").wait_for()
    card.filter(has_text=f"changes of route: {facts['replans']}, strikes: {facts['strikes']}").wait_for()
