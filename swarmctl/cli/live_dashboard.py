"""The dashboard of a flight: `swarmctl dashboard RUN --live` as a process beside it."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import webbrowser
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from threading import Thread

import typer

from swarmctl.cli.console import INTERRUPTED, USAGE, fail, say

NICENESS = 10
"""lower priority than the flight has, as for `nice`"""
MISSING = "the dashboard needs {}: in the folder of the project, pip install '.[{}]'"


@contextlib.contextmanager
def live_dashboard(folder: Path) -> Iterator[None]:
    """Show the flight that is recorded in a folder, and after its end until Ctrl-C.

    The dashboard reads the growing record, with a lower priority, so it cannot delay the flight. Exits if its
    packages are missing.
    """
    if find_spec("nicegui") is None:
        fail([MISSING.format("nicegui", "dashboard")], USAGE)
    # In a new session Ctrl-C does not end the dashboard, which shows the shutdown too.
    options = ["--live", "--parent-pid", str(os.getpid())]
    process = subprocess.Popen(
        [sys.executable, "-m", "swarmctl", "dashboard", str(folder), *options],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
    reader = Thread(target=_report, args=(process,), daemon=True)
    reader.start()
    try:
        try:
            yield
        except typer.Exit as ending:
            if ending.exit_code != INTERRUPTED:
                _keep(process)
            raise
        _keep(process)
    finally:
        process.terminate()
        process.wait()
        reader.join()


def _report(process: subprocess.Popen[str]) -> None:
    """Print what the process prints, and open its address in a browser of this desktop."""
    assert process.stdout is not None
    for line in process.stdout:
        say(f"dashboard: {line.rstrip()}")
        address = re.search(r"http://\S+", line)
        if address is not None and _has_desktop():
            webbrowser.open(address[0])


def _keep(process: subprocess.Popen[str]) -> None:
    """Serve the finished flight until Ctrl-C."""
    if process.poll() is None:
        with contextlib.suppress(KeyboardInterrupt, SystemExit):  # the latter by `entry`
            say("dashboard: the flight is over; Ctrl-C ends the dashboard")
            process.wait()


def _has_desktop() -> bool:
    """Return whether a browser has a window to open in; elsewhere it would write into this terminal."""
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
