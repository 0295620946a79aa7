"""The shipped example of a payload, where it cannot report: a sentence, and no traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

DETECTOR = Path(__file__).parents[2] / "configs" / "detector.py"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["tcp/127.0.0.1:1", "test", "3"], "nobody lets us in at tcp/127.0.0.1:1: does the flight run"),
        ([], "expected ENDPOINT SWARM SYSTEM_ID"),
    ],
)
def test_a_payload_that_cannot_report_says_why(words: list[str], said: str) -> None:
    done = subprocess.run(
        [sys.executable, str(DETECTOR), *words], capture_output=True, text=True, timeout=30.0, check=False
    )
    assert done.returncode == 1
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
