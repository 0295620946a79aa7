"""Workers as processes: dead ones lose nothing, and results are the same bytes."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from study_experiments import experiment_file
from swarmctl_process import swarmctl

from swarmctl.study.cluster import ClusterError, Workers, local_workers, workers_of

# Dask warns of a slow disk and of a busy machine.
pytestmark = [
    pytest.mark.filterwarnings("ignore::UserWarning:distributed"),
    pytest.mark.filterwarnings("ignore:Creating scratch"),
]
DASK = shutil.which("dask", path=str(Path(sys.executable).parent))


def square_unless_killed(number: int, mark: Path) -> int:
    """Return the square; the first process that gets here with 3 dies."""
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def test_a_task_whose_worker_dies_is_computed_again(tmp_path: Path) -> None:
    mark = tmp_path / "killed"
    workers: Workers[int, int]
    with local_workers(2) as workers:
        found = dict(workers.outcomes(iter(range(6)), square_unless_killed, lambda n: (n, mark)))
    assert mark.exists()
    assert found == {n: n * n for n in range(6)}


def test_a_scheduler_that_does_not_answer_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarmctl.study.cluster.CONNECT_S", 0.2)
    with pytest.raises(ClusterError, match=r"\[no-scheduler\]"), workers_of("tcp://127.0.0.1:9"):
        pass


@contextmanager
def dask(*words: str) -> Iterator[subprocess.Popen[str]]:
    assert DASK is not None
    process = subprocess.Popen([DASK, *words], stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def address_of(scheduler: subprocess.Popen[str]) -> str:
    assert scheduler.stderr is not None
    for line in scheduler.stderr:
        if match := re.search(r"Scheduler at:\s+(tcp://\S+)", line):
            return match[1]
    raise AssertionError("the scheduler has ended")


@pytest.mark.full
@pytest.mark.interop
def test_a_killed_worker_of_a_scheduler_changes_no_byte(tmp_path: Path) -> None:
    path = experiment_file(
        tmp_path,
        "factors: {planner.w: [0, 0.3, 0.6, 1]}",
        "worlds: 300",
    )
    here = swarmctl("study", "--config", path, "--out", tmp_path / "here", "--workers", 1)
    assert here.exit_code == 0, here.output
    with ExitStack() as stack:
        words = ("--host", "127.0.0.1", "--port", "0", "--dashboard-address", ":0")
        address = address_of(stack.enter_context(dask("scheduler", *words)))
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(tmp_path))
        workers = [stack.enter_context(dask("worker", address, *options)) for _ in range(3)]
        killed: list[str] = []

        parts = tmp_path / "there" / "experiment" / "parts"
        command = [sys.executable, "-m", "swarmctl", "study", "--config", str(path), "--scheduler", address]
        command += ["--out", str(tmp_path / "there")]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as there:
            assert there.stderr is not None
            for line in there.stderr:
                if re.match(r"[1-9]\d* of", line) and not killed:
                    workers[0].kill()
                    killed.append(line)
        assert there.returncode == 0
        assert killed
        assert len(list(parts.glob("*-rows.parquet"))) > 3
    name = "experiment/results.parquet"
    assert (tmp_path / "there" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()
