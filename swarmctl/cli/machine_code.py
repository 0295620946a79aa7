"""Machine code of the planners, compiled once in a separate process."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from swarmctl.cli.console import say
from swarmctl.config.model import Config
from swarmctl.planners.kernels.compilation import numba_cache

PROGRESS_TEXT = "compiling the planners, once on this machine"
COMPILER = (
    sys.executable,
    "-c",
    "from swarmctl.planners import warm_up; warm_up(lambda done, total: print(done, total, flush=True))",
)
"""command of the compiling process, which prints the number of compiled kernels and of all kernels"""


class CompilerError(Exception):
    """A failure of the compiling process, or no folder for machine code."""


def prepare(config: Config, console: Console) -> None:
    """Compile the planners if a configuration needs machine code; report the progress on the console.

    If the compiling process fails, or machine code cannot be stored, this process compiles later.
    """
    if not config.needs_machine_code:
        return
    try:
        if not ready_file().exists():
            compile_all(console)
    except CompilerError as error:
        say(str(error), console=console)


def compile_all(console: Console, compiler: Sequence[str] = COMPILER) -> float:
    """Compile in another process and show its progress; return the duration [s]. Raises CompilerError."""
    file, began_s = ready_file(), time.monotonic()
    with subprocess.Popen(compiler, stdout=subprocess.PIPE, text=True) as process:
        try:
            _show(_progress(process), console)
        except BaseException:
            process.kill()
            raise
    if process.returncode != 0:
        raise CompilerError(
            f"the compiling process ended with exit code {process.returncode}; see the messages above"
        )
    file.touch()
    return time.monotonic() - began_s


def ready_file() -> Path:
    """Return the path of a file that exists if this machine has this version's machine code.

    Raises CompilerError if no folder is writable.
    """
    if (stored := numba_cache()) is None:
        text = "machine code cannot be stored, so every run compiles the planners"
        raise CompilerError(f"{text}; set NUMBA_CACHE_DIR to a writable folder")
    folder, key = stored
    return folder / f"swarmctl-{key}.ready"


def _progress(process: subprocess.Popen[str]) -> Iterator[tuple[int, int]]:
    assert process.stdout is not None
    for text in process.stdout:
        done, total = map(int, text.split())
        yield done, total


def _show(progress: Iterator[tuple[int, int]], console: Console) -> None:
    """Show a bar on a terminal, a line for each kernel elsewhere."""
    if not console.is_terminal:
        say(PROGRESS_TEXT, console=console)
        for done, total in progress:
            say(f"compiled: {done} of {total} kernels", console=console)
        return
    columns = TextColumn(PROGRESS_TEXT), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(PROGRESS_TEXT, total=None)
        for done, total in progress:
            bar.update(task, completed=done, total=total)
