"""The program as a process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROGRAM = "from swarmctl.cli.entry import main; main()"
SWARMCTL = [sys.executable, "-c", PROGRAM]


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
