"""`swarmctl set` with two swarms in processes of their own and commands from a third."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import pytest
from swarmctl_process import ROOT, read_until, run, started

pytestmark = [pytest.mark.interop, pytest.mark.full]

SMALL = """\
name: NAME
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
planner: {w: 0.5}
simulate: {count: 2, speedup: 2, ready_s: 0}
flight: {on_exit: hold}
"""


@dataclass
class Place:
    """A folder in which swarms fly and in which commands find them."""

    folder: Path

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "TMPDIR": str(self.folder), "PYTHONPATH": str(ROOT)}

    def fly(self, name: str) -> AbstractContextManager[subprocess.Popen[str]]:
        config = self.folder / f"{name}.yaml"
        config.write_text(SMALL.replace("NAME", name))
        words = ("fly", "--config", config, "--out", self.folder / name)
        return started(*words, cwd=self.folder, env=self.environment)

    def set(self, *words: str) -> subprocess.CompletedProcess[str]:
        return self.run("set", *words)

    def run(self, *words: str, **variables: str) -> subprocess.CompletedProcess[str]:
        return run(*words, cwd=self.folder, env=self.environment | variables)

    def summary(self, name: str) -> dict[str, object]:
        (run,) = (self.folder / name).iterdir()
        content: dict[str, object] = json.loads((run / "summary.json").read_text())
        return content


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def test_one_of_two_swarms_takes_a_command_and_the_other_is_unaffected(place: Place) -> None:
    with place.fly("one") as one, place.fly("two") as two:
        for flight in (one, two):
            read_until(flight, "uav2: flying")
        taken = place.set("--swarm", "one", "--uav", "uav2", "--w", "0.9")
        assert (taken.returncode, taken.stderr) == (0, "")
        assert re.match(r"uav2: w = 0\.9 .*\d", taken.stdout)
        read_until(one, taken.stdout.strip().partition(";")[0])

        # Neither command changes a file, so both may run at the same time.
        with ThreadPoolExecutor() as pool:
            refused = [
                pool.submit(place.set, *words, "--w", "0.1")
                for words in (("--uav", "2"), ("--swarm", "one", "--uav", "7"))
            ]
        unclear, unknown = (done.result() for done in refused)
        assert unclear.returncode == 2
        assert "[which-swarm]" in unclear.stderr
        assert re.search(r"\bone\b.* tcp/127\.0\.0\.1:", unclear.stderr)
        assert unknown.returncode == 1
        assert re.search(r"\b7\b.*\[unknown-vehicle\]", unknown.stderr)

        for flight in (one, two):
            flight.send_signal(signal.SIGINT)
        for flight in (one, two):
            read_until(flight, "run folder:")
            assert flight.wait(timeout=30.0) == 130
    changed, untouched = place.summary("one"), place.summary("two")
    assert changed["operator_commands"] == {"passed_on": 1, "refused": 0}
    assert untouched["operator_commands"] == {"passed_on": 0, "refused": 0}
    assert weights(changed) == [[0.5], [0.5, 0.9]]
    assert weights(untouched) == [[0.5], [0.5]]
    gone = place.set("--config", "one.yaml", "--all", "--w", "0.1")
    assert gone.returncode == 1
    assert "one" in gone.stderr


def test_another_user_can_neither_land_nor_set_the_swarm_and_its_operator_can(place: Place) -> None:
    stranger = Place(place.folder / "stranger")  # another folder of running swarms: another user's
    stranger.folder.mkdir()
    (token := stranger.folder / "token").write_text("0123456789abcdef" * 4)
    token.chmod(0o600)
    with place.fly("one") as flight:
        read_until(flight, "uav2: flying")
        (entry,) = (place.folder / f"swarmctl-{os.getuid()}").glob("one.*.json")
        there = ["--swarm", "one", "--connect", json.loads(entry.read_text())["endpoint"]]
        for words in (["abort", "land", "--all"], ["set", "--all", "--w", "0.9"]):
            refused = stranger.run(*words, *there)
            assert (refused.returncode, "[no-token]" in refused.stderr) == (1, True), refused
            refused = stranger.run(*words, *there, SWARMCTL_TOKEN_FILE=str(token))
            assert (refused.returncode, "[wrong-token]" in refused.stderr) == (1, True), refused
        read_until(flight, "[wrong-token]")
        taken = place.run("abort", "land", "--all", *there)
        assert taken.returncode == 0, taken
        read_until(flight, "run folder:")
    assert place.summary("one")["operator_commands"] == {"passed_on": 2, "refused": 2}


def weights(summary: dict[str, object]) -> list[list[float]]:
    vehicles = summary["vehicles"]
    assert isinstance(vehicles, list)
    return [[entry["w"] for entry in vehicle["weights"]] for vehicle in vehicles]
