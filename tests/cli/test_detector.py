"""The shipped example of a payload exits with one line, and without a traceback, if it cannot report."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

DETECTOR = Path(__file__).parents[2] / "configs" / "detector.py"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["tcp/127.0.0.1:1", "test", "3"], "tcp/127.0.0.1:1"),
        ([], "ENDPOINT SWARM SYSTEM_ID"),
    ],
)
def test_a_payload_that_cannot_connect_exits_with_one_line(words: list[str], named: str) -> None:
    done = subprocess.run(
        [sys.executable, str(DETECTOR), *words], capture_output=True, text=True, timeout=30.0, check=False
    )
    assert done.returncode == 1
    assert named in done.stderr
    assert len(done.stderr.splitlines()) == 1
