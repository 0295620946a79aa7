"""Flights of the set-up: `swarmctl fly` as a process that does not end with the dashboard."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Thread

import typer

from swarmctl.cli.console import run_folder, say
from swarmctl.config.scenario import Scenario
from swarmctl.dashboard.flights import NotStarted

OUTPUT = "fly.log"
"""file in the run folder with the output of the process"""


class SetupFlight:
    """A process of `swarmctl fly`, with its output in the run folder."""

    def __init__(self, config: Path, scenario: Scenario, real: Sequence[str], runs: Path) -> None:
        """Start the flight; `real`: names of the real vehicles, as typed. Raises NotStarted."""
        try:
            self.folder = run_folder(runs, scenario.config.name)
        except typer.Exit as error:
            raise NotStarted(f"the run folder below {runs} cannot be created") from error
        confirmation = ["--real", "--confirm", ",".join(real)] if real else []
        self._log = self.folder / OUTPUT
        with self._log.open("wb") as output:
            # In a session of its own, Ctrl-C of the dashboard does not reach the flight.
            self._process = subprocess.Popen(
                [sys.executable, "-m", "swarmctl", "fly", "--config", str(config),
                 "--run-folder", str(self.folder), *confirmation],
                stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True,
            )  # fmt: skip
        swarm = scenario.config.name
        say(
            f"flight of {swarm} started: process {self._process.pid}, output in {self._log}; it "
            f"does not end with the dashboard: swarmctl abort return --all --swarm {swarm}"
        )

        Thread(target=self._report, args=(swarm,), daemon=True).start()

    def _report(self, swarm: str) -> None:
        say(f"flight of {swarm} ended with exit code {self._process.wait()}: {self.folder}")

    def is_over(self) -> bool:
        return self._process.poll() is not None

    def output(self) -> list[str]:
        return self._log.read_text(errors="replace").splitlines()
