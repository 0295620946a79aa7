"""Batches: every missing mission once, in portions of about a second."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from swarmctl.study.batches import BATCH_S, GREATEST_GROWTH, BatchQueue, missing

ranges = st.builds(lambda start, n: range(start, start + n), st.integers(0, 40), st.integers(1, 15))


@given(ranges, st.lists(ranges))
def test_the_missing_seeds_are_the_wanted_ones_that_are_not_done(wanted: range, done: list[range]) -> None:
    left = [seed for part in missing(wanted, done) for seed in part]
    assert left == sorted(set(wanted) - {seed for part in done for seed in part})


@given(st.dictionaries(st.integers(0, 5), st.lists(ranges), max_size=5), st.floats(1e-4, 10.0))
def test_every_mission_is_in_one_batch_whatever_it_costs(left: dict[int, list[range]], cost_s: float) -> None:
    queue = BatchQueue(left)
    seen: list[tuple[int, int]] = []
    for batch in queue:
        seen += [(batch.level, seed) for seed in batch.seeds]
        queue.note_duration(batch, cost_s * len(batch.seeds))
    assert sorted(seen) == sorted((level, s) for level, parts in left.items() for part in parts for s in part)
    assert queue.n_left == 0


def test_batches_grow_to_about_a_second_of_work() -> None:
    queue, cost_s = BatchQueue({0: [range(100_000)]}), 0.002
    sizes = []
    for batch, _ in zip(queue, range(8), strict=False):
        sizes.append(len(batch.seeds))
        queue.note_duration(batch, cost_s * len(batch.seeds))
    assert sizes[1] == GREATEST_GROWTH * sizes[0]
    assert sizes[-1] * cost_s == BATCH_S


def test_all_levels_advance_together() -> None:
    queue = BatchQueue({0: [range(100)], 1: [range(100)]})
    counts = {0: 0, 1: 0}
    for batch in queue:
        counts[batch.level] += len(batch.seeds)
        assert abs(counts[0] - counts[1]) <= len(batch.seeds)
