"""The results folder: parts while a study runs, then tables that are the same bytes for any workers.

experiment.yaml, base.yaml   the experiment, to do it again from this folder
manifest.json                versions, commit, seeds, factors and times
parts/                       one file a finished batch; its name has level and seeds
results.parquet              one row a vehicle and mission, sorted by level, seed and uav
tracks.parquet, hostiles.parquet   cells of the seeds whose tracks are kept
"""

from __future__ import annotations

import fcntl
import io
import json
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from swarmctl.core.whole_file import write_whole
from swarmctl.study.batches import Batch
from swarmctl.study.experiment import Experiment
from swarmctl.study.levels import Level
from swarmctl.study.tables import Columns, Table

TABLES = {"rows": "results.parquet", "tracks": "tracks.parquet", "hostiles": "hostiles.parquet"}
ROWS_A_GROUP = 1 << 16
"""rows of a row group of results.parquet: fixed, so that its bytes do not depend on the parts"""
BYTES_A_VALUE = 8
LEVEL_KEYS = ("levels", "changes")
"""keys of an experiment's identity that follow from its factors"""
_ABSENT = object()
_PART = re.compile(r"level-(\d+)-seeds-(\d+)-(\d+)-rows\.parquet")


class ResultsError(Exception):
    """A folder that cannot take the results. The text says what to do."""


class Results:
    """A results folder that this process writes."""

    def __init__(self, folder: Path, experiment: Experiment) -> None:
        self.folder = folder
        self._experiment = experiment
        self._types = {name: pa.scalar(values[0]).type for name, values in experiment.values.items()}
        self._parts = folder / "parts"
        self._done: dict[int, list[range]] = {level.index: [] for level in experiment.levels}
        for path in self._parts.glob("*.parquet"):
            if match := _PART.fullmatch(path.name):
                level, first, stop = map(int, match.groups())
                self._done[level].append(range(first, stop))

    def done(self, level: int) -> list[range]:
        """Return the finished seeds of a level."""
        return self._done[level]

    def add(self, batch: Batch, table: Table) -> None:
        """Keep the results of a batch on the disk."""
        for name in reversed(TABLES):  # the rows come last: they say that the batch is finished
            columns: Columns = getattr(table, name)
            if name == "rows" or (columns and len(next(iter(columns.values())))):
                part = pa.table(dict(columns))
                path = self._part(batch.level, batch.seeds, name)
                content = io.BytesIO()
                pq.write_table(part, content, compression="zstd")
                write_whole(path, content.getvalue())
        self._done[batch.level].append(batch.seeds)

    def values(self, level: int, measure: str, seeds: range) -> tuple[np.ndarray, np.ndarray]:
        """Return a measure of all rows of a level, and the seed of each row."""
        tables = [table.select([measure, "seed"]) for table in self._tables(level, "rows", seeds)]
        table = pa.concat_tables(tables)
        return table[measure].to_numpy(), table["seed"].to_numpy()

    def finish(self, seeds: range) -> int:
        """Write the tables of `seeds` of all levels; return the number of rows."""
        n_rows = 0
        for name, file in TABLES.items():
            tables = [
                self._with_level(level, table, with_factors=name == "rows")
                for level in self._experiment.levels
                for table in self._tables(level.index, name, seeds)
            ]
            if not tables:
                continue
            whole, temporary = (
                pa.concat_tables(tables).combine_chunks(),
                (self.folder / file).with_suffix(".tmp"),
            )
            pq.write_table(whole, temporary, row_group_size=ROWS_A_GROUP, compression="zstd")
            temporary.replace(self.folder / file)
            n_rows = len(whole) if name == "rows" else n_rows
        return n_rows

    def write_manifest(self, manifest: Mapping[str, Any]) -> None:
        """Replace the manifest."""
        text = json.dumps(manifest, indent=1, ensure_ascii=False) + "\n"
        write_whole(self.folder / "manifest.json", text.encode())

    def _part(self, level: int, seeds: range, name: str) -> Path:
        return self._parts / f"level-{level:05}-seeds-{seeds.start}-{seeds.stop}-{name}.parquet"

    def _tables(self, level: int, name: str, seeds: range) -> Iterator[pa.Table]:
        """Yield the parts of a level by ascending seeds, without other seeds than `seeds`."""
        for part in sorted(self._done[level], key=lambda part: part.start):
            path = self._part(level, part, name)
            if part.start >= seeds.stop or part.stop <= seeds.start or not path.exists():
                continue
            try:
                table = pq.read_table(path)
            except (OSError, pa.ArrowException) as error:
                text = f"{path} is damaged ({error}); remove it, and repeat the command [part-damaged]"
                raise ResultsError(text) from error
            seed = table["seed"].to_numpy()
            yield table.filter(pa.array((seed >= seeds.start) & (seed < seeds.stop)))

    def _with_level(self, level: Level, table: pa.Table, *, with_factors: bool) -> pa.Table:
        """Return a table with the level, and the values of the factors, as columns before its own."""
        first = {"level": pa.scalar(level.index, pa.int32())}
        if with_factors:
            first |= {name: pa.scalar(value, self._types[name]) for name, value in level.values.items()}
        columns = {name: pa.repeat(value, len(table)) for name, value in first.items()}
        return pa.table(columns | {name: table[name] for name in table.column_names})


@contextmanager
def open_results(folder: Path, experiment: Experiment) -> Iterator[Results]:
    """Create a results folder, or go on with that of an interrupted study. Raises ResultsError."""
    _require_space(folder, experiment)
    try:
        (folder / "parts").mkdir(parents=True, exist_ok=True)
        lock = (folder / "lock").open("w")
    except OSError as error:
        raise ResultsError(f"{folder}: the folder cannot be written: {error.strerror}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            text = f"{folder}: another `swarmctl study` writes this folder; wait for its end, or give --out"
            raise ResultsError(f"{text} [folder-taken]") from None
        _require_same(folder, experiment)
        (folder / "experiment.yaml").write_text(experiment.portable_text, encoding="utf-8")
        (folder / "base.yaml").write_text(experiment.base_text, encoding="utf-8")
        for file in (folder / "parts").glob(".*.new"):
            file.unlink()
        yield Results(folder, experiment)


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a results folder; empty if there is none."""
    path = folder / "manifest.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def _require_same(folder: Path, experiment: Experiment) -> None:
    manifest = read_manifest(folder)
    there, here = manifest.get("experiment"), experiment.identity
    if there is None or there == here:
        return
    named = _different({"factors": manifest.get("factors")}, {"factors": dict(experiment.values)})
    if named:  # each level differs too, which says nothing more
        there, here = ({k: v for k, v in data.items() if k not in LEVEL_KEYS} for data in (there, here))
    shown = [*named, *_different(there, here)]
    more = f"; and {len(shown) - 3} more" if len(shown) > 3 else ""
    text = f"{folder} has the results of another experiment: {'; '.join(shown[:3])}{more}"
    raise ResultsError(f"{text}; give another --out, or remove the folder [other-experiment]")


def _different(there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """Return the keys that differ, each with both values."""
    before, now = dict(_flat(there)), dict(_flat(here))
    return [
        f"{key}: {_shown(before, key)} there, {_shown(now, key)} here"
        for key in dict.fromkeys((*now, *before))
        if before.get(key, _ABSENT) != now.get(key, _ABSENT)
    ]


def _shown(values: Mapping[str, Any], key: str) -> str:
    return repr(values[key]) if key in values else "nothing"


def _flat(data: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(data, dict) and data:
        for key, value in data.items():
            yield from _flat(value, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(data, list) and data:
        if not any(isinstance(value, dict | list) for value in data):
            yield prefix, data
            return
        for index, value in enumerate(data):
            yield from _flat(value, f"{prefix}[{index}]")
    else:
        yield prefix, data


def _require_space(folder: Path, experiment: Experiment) -> None:
    n_columns = len(experiment.kind.measures) + len(experiment.factors) + 3
    needed = 2 * experiment.most_rows * n_columns * BYTES_A_VALUE
    present = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    free = shutil.disk_usage(present).free
    if needed > free:
        raise ResultsError(
            f"{folder}: {experiment.most_rows} rows need up to {needed / 1e9:.1f} GB, and only "
            f"{free / 1e9:.1f} GB are free; give fewer worlds or values, or --out on another disk "
            "[disk-too-small]"
        )
