"""The shipped example of a payload exits with one line, and without a traceback, if it cannot report."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

DETECTOR = Path(__file__).parents[2] / "configs" / "detector.py"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["test", "3", "tcp/127.0.0.1:1", "token"], "tcp/127.0.0.1:1"),
        (["test", "3"], "no flight of test"),
        ([], "SWARM SYSTEM_ID"),
    ],
)
def test_a_payload_that_cannot_connect_exits_with_one_line(
    words: list[str], named: str, tmp_path: Path
) -> None:
    (tmp_path / "token").write_text("t" * 64)
    done = subprocess.run(
        [sys.executable, str(DETECTOR), *words],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=30.0,
        check=False,
    )
    assert done.returncode == 1
    assert named in done.stderr
    assert len(done.stderr.splitlines()) == 1
