"""A study from beginning to end: batches go to the workers, and their results into the folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Any

import msgspec

from swarmctl.study import provenance
from swarmctl.study.batches import Batch, BatchQueue, missing
from swarmctl.study.cluster import ClusterError, Workers
from swarmctl.study.experiment import Experiment
from swarmctl.study.kinds import compute
from swarmctl.study.results import Results, read_manifest
from swarmctl.study.tables import Table

Progress = Callable[[int, int], None]
"""called with the number of finished missions, and of all missions as far as decided"""
NextBlock = Callable[[int, float], None]
"""called before one more block of `until`, with the number of worlds and half the widest interval"""


class Outcome(msgspec.Struct, frozen=True):
    """A finished study."""

    n_worlds: int
    n_rows: int
    widest: float | None
    """with `until`: the widest half of an interval at the end"""


def run(
    experiment: Experiment,
    results: Results,
    workers: Workers[Batch, Any],
    progress: Progress,
    command: str,
    next_block: NextBlock = lambda _n, _widest: None,
) -> Outcome:
    """Compute what the folder lacks, and write its tables. Raises ClusterError and ResultsError.

    The folder keeps the finished batches if this function is interrupted.
    """
    manifest = _manifest(experiment, results, command)
    before_s, began_s = manifest["elapsed_s"], time.monotonic()
    results.write_manifest(manifest)
    widest: float | None = None
    seeds = experiment.seeds
    try:
        for seeds in _blocks(experiment):
            _compute(experiment, results, workers, seeds, progress)
            widest = _widest(experiment, results, seeds)
            if experiment.is_precise(widest):
                break
            if widest is not None and len(seeds) < experiment.worlds:
                next_block(len(seeds), widest)
        n_rows = results.finish(seeds)
        manifest |= {"worlds": len(seeds), "missions": len(seeds) * len(experiment.levels)}
    finally:
        manifest |= {"elapsed_s": round(before_s + time.monotonic() - began_s, 3)}
        manifest |= {"workers": workers.n_cores}
        results.write_manifest(manifest)
    return Outcome(len(seeds), n_rows, widest)


def _blocks(experiment: Experiment) -> Iterator[range]:
    """Yield the seeds to have at each decision: all of them, or one more block each time with `until`."""
    seeds, until = experiment.seeds, experiment.section.until
    if until is not None:
        for stop in range(until.block, len(seeds), until.block):
            yield seeds[:stop]
    yield seeds


def _compute(
    experiment: Experiment, results: Results, workers: Workers[Batch, Any], seeds: range, progress: Progress
) -> None:
    kind, kept = experiment.section.kind, frozenset(experiment.section.tracks)
    queue = BatchQueue({i: missing(seeds, results.done(i)) for i in range(len(experiment.levels))})
    total = len(seeds) * len(experiment.levels)
    done = total - queue.n_left
    progress(done, total)

    def arguments(batch: Batch) -> tuple[Any, ...]:
        setup = experiment.setups[batch.level]
        return kind, setup.config, setup.settings, batch.seeds, kept

    for batch, (table, seconds, versions) in workers.outcomes(queue, compute, arguments):
        _require_same_versions(versions)
        assert isinstance(table, Table)
        queue.note_duration(batch, seconds)
        results.add(batch, table)
        done += len(batch.seeds)
        progress(done, total)


def _require_same_versions(versions: Mapping[str, str]) -> None:
    ours = provenance.versions()
    for name in provenance.DECISIVE:
        if versions.get(name) != ours.get(name):
            raise ClusterError(
                f"a worker has {name} {versions.get(name)}, and this program has {ours.get(name)}; install "
                "equal versions, because results could differ [worker-other]"
            )


def _widest(experiment: Experiment, results: Results, seeds: range) -> float | None:
    """Return half the width of the widest interval of all levels; None without `until`."""
    if (until := experiment.section.until) is None:
        return None
    from swarmctl.study.statistics import estimate  # noqa: PLC0415 - scipy.stats loads slowly

    measured = (results.values(level.index, until.measure, seeds) for level in experiment.levels)
    return max(float(estimate(values, worlds).half_width) for values, worlds in measured)


def _manifest(experiment: Experiment, results: Results, command: str) -> dict[str, Any]:
    before = read_manifest(results.folder)
    grid = experiment.setups[0].config.grid
    return {
        "question": experiment.section.question,
        "kind": experiment.section.kind,
        "command": command,
        "factors": dict(experiment.values),
        "first_seed": experiment.seeds.start,
        "worlds": 0,
        "missions": 0,
        "rows": grid.rows,
        "cols": grid.cols,
        "started": before.get("started", datetime.now(UTC).isoformat(timespec="seconds")),
        "elapsed_s": before.get("elapsed_s", 0.0),
        "versions": provenance.versions(),
        "commit": provenance.commit(),
        "experiment": experiment.identity,
    }
