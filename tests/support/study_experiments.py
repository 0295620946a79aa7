"""Experiment files for tests, and a kind that computes at once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
from swarmctl_process import SHIPPED

from swarmctl.config.scenario import Scenario
from swarmctl.study.experiment import Experiment, load_experiment
from swarmctl.study.kinds import Kind
from swarmctl.study.tables import SeedResult
from swarmctl.study.world import World

FACTORS = "factors: {planner.w: [0, 0.5, 1], simulate.count: [1, 2]}"


def experiment_file(folder: Path, *lines: str, base: str | None = None) -> Path:
    """Write an experiment of the shipped configuration, or of the text `base`, and return its file."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "swarm.yaml").write_text(SHIPPED.read_text(encoding="utf-8") if base is None else base)
    path = folder / "experiment.yaml"
    path.write_text("\n".join(["question: Why?", "base: swarm.yaml", *lines]) + "\n", encoding="utf-8")
    return path


def small_experiment(folder: Path, *lines: str, worlds: int = 20) -> Experiment:
    """Return an experiment of six levels."""
    return load_experiment(experiment_file(folder, FACTORS, *lines), worlds)


class QuickRow(msgspec.Struct, frozen=True):
    uav: int
    strikes: int
    survived: bool


def quick_kind(before_seed: Callable[[int], None] = lambda _: None) -> Kind:
    """Return a kind whose strikes are drawn from seed, vehicle and w; `before_seed` runs before each seed."""

    def computer(scenario: Scenario, _: object) -> Callable[[World], SeedResult[QuickRow]]:
        p = 0.1 + 0.5 * scenario.config.planner.w

        def drawn(world: World) -> SeedResult[QuickRow]:
            before_seed(world.seed)
            rows = []
            for spec in reversed(scenario.specs):
                strikes = int(np.random.default_rng((world.seed, spec.sysid)).binomial(9, p))
                rows.append(QuickRow(spec.sysid, strikes, strikes == 0))
            return SeedResult(tuple(rows), ((scenario.specs[0].entry,),))

        return drawn

    return Kind(QuickRow, computer)
