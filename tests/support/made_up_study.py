"""A made-up results folder: missions drawn from simple formulas, with the columns of a real one."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml


def rows(factors: Mapping[str, Sequence[Any]], n_worlds: int = 30, n_vehicles: int = 5) -> pd.DataFrame:
    """Return a table of every combination of `factors`; danger falls with w and with the range."""
    rng = np.random.default_rng(5)
    danger = rng.gamma(9.0, 1 / 9.0, size=n_worlds)
    tables = []
    for level, values in enumerate(itertools.product(*factors.values())):
        at = dict(zip(factors, values, strict=True))
        n = int(at.get("simulate.count", n_vehicles))
        w, k = float(at.get("planner.w", 0.5)), at.get("communication.range", 2)
        k = float(min(n - 1, 4) if k == "all" else k)
        shift = 0.05 * (sum(map(ord, str(at.get("planner.name", "")))) % 7)
        seeds, uavs = np.repeat(np.arange(n_worlds), n), np.tile(np.arange(n), n_worlds)
        length = 20 + 7 * w**2 + rng.normal(0, 0.8, seeds.size) + 3 * shift
        exposure = danger[seeds] * (2.6 - 1.7 * w) * (0.7 + 0.3 * np.exp(-k / 2)) * (1 - shift)
        exposure = exposure * rng.gamma(20, 1 / 20, seeds.size)
        strikes = rng.poisson(exposure * 0.9)
        safety = np.exp(-exposure * 1.05)
        tables.append(
            pd.DataFrame(
                {
                    "level": np.int32(level),
                    **dict.fromkeys(factors),
                    "seed": seeds,
                    "uav": uavs.astype(np.int16),
                    "arrived": True,
                    "length_cells": length,
                    "length_m": length * 40,
                    "exposure_sum": exposure,
                    "safety_factor": safety,
                    "strikes": strikes,
                    "survived": strikes == 0,
                    "searches": rng.poisson(20, seeds.size),
                    "messages_sent": rng.poisson(12 * k, seeds.size),
                }
            ).assign(**at)
        )
    return pd.concat(tables, ignore_index=True)


def tracks(table: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return tracks and hostiles of seed 0 in an area of 20 × 20 cells."""
    size = 20
    rng = np.random.default_rng(3)
    parts = []
    for (level, uav), _ in table[table["seed"] == 0].groupby(["level", "uav"]):
        steps = rng.integers(-1, 2, size) * (rng.random(size) < 0.4 + 0.1 * level)
        row = np.clip(2 + 4 * uav + np.cumsum(steps), 0, size - 1)
        columns = {"level": level, "seed": 0, "uav": uav, "step": np.arange(size), "row": row}
        parts.append(pd.DataFrame(columns | {"col": np.arange(size), "strikes": rng.random(size) < 0.08}))
    cells = rng.choice(size * size, 24, replace=False)
    of_level = pd.DataFrame({"seed": 0, "row": cells // size, "col": cells % size})
    hostiles = pd.concat([of_level.assign(level=level) for level in table["level"].unique()])
    return pd.concat(parts), hostiles


def folder(
    path: Path, factors: Mapping[str, Sequence[Any]], figures: Sequence[Mapping[str, Any]], n_worlds: int = 30
) -> Path:
    """Write a results folder and return it."""
    path.mkdir(parents=True, exist_ok=True)
    table = rows(factors, n_worlds)
    for name, values in factors.items():
        if len({type(value) for value in values}) > 1 and not all(isinstance(v, int | float) for v in values):
            table[name] = table[name].astype(str)
    table.to_parquet(path / "results.parquet")
    flown, hostiles = tracks(table)
    flown.to_parquet(path / "tracks.parquet")
    hostiles.to_parquet(path / "hostiles.parquet")
    question = "Does communication save strikes?"
    experiment = {
        "question": question,
        "figures": [dict(figure) for figure in figures],
    }
    (path / "experiment.yaml").write_text(yaml.safe_dump(experiment), encoding="utf-8")
    manifest = {
        "question": question, "kind": "missions", "factors": {k: list(v) for k, v in factors.items()},
        "command": "swarmctl study --config configs/studies/communication.yaml", "first_seed": 0,
        "worlds": n_worlds, "missions": n_worlds * int(table["level"].nunique()), "rows": 20, "cols": 20,
        "started": "2026-11-23T22:00:00+00:00", "elapsed_s": 73.2, "workers": 2,
        "versions": {"swarmctl": "0.1.0", "python": "3.11.9", "numpy": "2.3.1"}, "commit": "abc1234",
    }  # fmt: skip
    (path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    return path
