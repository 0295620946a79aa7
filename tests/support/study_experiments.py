"""Experiment files for tests, and a kind that computes at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np
from cli_runner import SHIPPED

from swarmctl.config.scenario import Scenario
from swarmctl.study.experiment import Experiment, load_experiment
from swarmctl.study.kinds import Kind
from swarmctl.study.missions import Table

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


def quick_kind(before_seed: Callable[[int], None] = lambda _: None) -> Kind:
    """Return a kind whose strikes are drawn from seed, vehicle and w; `before_seed` runs before each seed."""

    def compute(scenario: Scenario, seeds: Sequence[int], kept: Collection[int], _: object) -> Table:
        rows = []
        for seed in seeds:
            before_seed(seed)
            for spec in reversed(scenario.specs):
                p = 0.1 + 0.5 * scenario.config.planner.w
                rows.append((seed, spec.sysid, np.random.default_rng((seed, spec.sysid)).binomial(9, p)))
        seed, uav, strikes = np.array(rows, dtype=np.int64).reshape(-1, 3).T
        kept_seeds = np.array(sorted(kept), dtype=np.int64)
        track = {"seed": kept_seeds, "uav": np.ones_like(kept_seeds), "step": np.zeros_like(kept_seeds)}
        return Table(
            {"seed": seed, "uav": uav.astype(np.int16), "strikes": strikes, "survived": strikes == 0},
            track | {"row": kept_seeds, "col": kept_seeds},
            {"seed": kept_seeds, "row": kept_seeds, "col": kept_seeds},
        )

    return Kind(compute, ("strikes", "survived"))
