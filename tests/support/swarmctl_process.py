"""The program as a process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


SWARMCTL = [sys.executable, "-c", "from swarmctl.cli.entry import main; main()"]


def run(*words: str | Path, cwd: Path, timeout_s: float = 90.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*SWARMCTL, *map(str, words)], cwd=cwd, timeout=timeout_s, capture_output=True, text=True, check=False
    )


def read_until(process: subprocess.Popen[str], text: str) -> list[str]:
    assert process.stdout is not None
    lines: list[str] = []
    for line in process.stdout:
        lines.append(line.rstrip())
        if text in line:
            return lines
    raise AssertionError(f"it ended without saying {text!r}:\n" + "\n".join(lines))
