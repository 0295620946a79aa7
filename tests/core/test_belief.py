import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from swarmctl.core.belief import CLEAR, OCCUPIED, UNKNOWN, Belief
from swarmctl.core.observation import Checkpoint, Observation, checkpoint

QUICK = settings(max_examples=examples(60), deadline=None, derandomize=True)
ROWS, COLS = 4, 5


def seen(observer: int, seq: int, *cells: tuple[int, int, bool]) -> Observation:
    return Observation(observer, seq + 1, 0.5 * seq, cells)


cells = st.tuples(st.integers(0, ROWS - 1), st.integers(0, COLS - 1), st.booleans())
contents = st.lists(cells, max_size=9).map(tuple)
# one content for each name, as in a correct swarm; contradictions between observations are included
observations = st.dictionaries(st.tuples(st.integers(1, 3), st.integers(1, 5)), contents, max_size=10).map(
    lambda by_name: [Observation(o, s, float(s), c) for (o, s), c in by_name.items()]
)


@QUICK
@given(observations, st.randoms(use_true_random=False), st.integers(0, 3))
def test_order_repetition_and_grouping_do_not_matter(observations, random, n_repeats) -> None:
    at_once = Belief.prior(ROWS, COLS, 6).merge(observations)
    shuffled = observations * (1 + n_repeats)
    random.shuffle(shuffled)
    one_by_one = Belief.prior(ROWS, COLS, 6)
    for observation in shuffled:
        one_by_one = one_by_one.merge([observation])
    np.testing.assert_array_equal(one_by_one.known, at_once.known)
    assert list(one_by_one.items()) == list(at_once.items())
    assert set(at_once.items()) == set(observations)


@QUICK
@given(observations, observations)
def test_merging_does_not_change_the_original_belief(first, second) -> None:
    observers = {(o.observer, o.seq) for o in first}
    before = Belief.prior(ROWS, COLS, 6).merge(first)
    known, held = before.known.copy(), list(before.items())
    before.merge(o for o in second if (o.observer, o.seq) not in observers)
    np.testing.assert_array_equal(before.known, known)
    assert list(before.items()) == held


@QUICK
@given(observations)
def test_merging_known_observations_returns_the_same_belief(observations) -> None:
    belief = Belief.prior(ROWS, COLS, 6).merge(observations)
    assert belief.merge(observations) is belief
    assert belief.merge([]) is belief


@QUICK
@given(observations, st.integers(0, ROWS * COLS))
def test_occupancy_is_a_probability_for_any_announced_number(observations, n_hostiles) -> None:
    belief = Belief.prior(ROWS, COLS, n_hostiles).merge(observations)
    p = belief.occupancy()
    assert p.shape == (ROWS, COLS)
    assert ((p >= 0.0) & (p <= 1.0)).all()
    assert (p[belief.known == OCCUPIED] == 1.0).all()
    assert (p[belief.known == CLEAR] == 0.0).all()
    if 0 <= n_hostiles - belief.n_found <= ROWS * COLS - belief.n_observed:
        assert p.sum() == pytest.approx(n_hostiles)


def test_eq_4_after_nine_cells_of_the_model() -> None:
    around = ((r, c, (r, c) == (10, 10)) for r in (9, 10, 11) for c in (9, 10, 11))
    belief = Belief.prior(20, 20, 24).merge([seen(1, 0, *around)])
    assert (belief.n_observed, belief.n_found) == (9, 1)
    p = belief.occupancy()
    assert p[0, 0] == pytest.approx(0.0588235, abs=5e-8)
    assert p[10, 10] == 1.0
    assert p[9, 11] == 0.0


@pytest.mark.parametrize(
    ("n_hostiles", "n_occupied", "n_clear", "p_unseen", "too_low"),
    [
        (2, 3, 0, 0.0, True),  # more found than announced: no negative probability
        (2, 2, 0, 0.0, False),
        (18, 0, 4, 1.0, False),  # 18 missing, 16 cells left: no probability above one
        (16, 0, 4, 1.0, False),
        (3, 3, 17, 0.0, False),  # every cell observed: nothing to divide by
        (4, 3, 17, 0.0, False),
        (2, 3, 17, 0.0, True),
    ],
)
def test_a_wrong_announced_number_keeps_probabilities_valid(
    n_hostiles: int, n_occupied: int, n_clear: int, p_unseen: float, too_low: bool
) -> None:
    observed = [(i // COLS, i % COLS, i < n_occupied) for i in range(n_occupied + n_clear)]
    belief = Belief.prior(ROWS, COLS, n_hostiles).merge([seen(1, 0, *observed)])
    assert belief.announced_too_low == too_low
    assert (belief.occupancy()[belief.known == UNKNOWN] == p_unseen).all()


def test_occupied_wins_over_clear_in_either_order() -> None:
    # DEVIATION: the paper's sensors never contradict each other.
    clear, occupied = seen(1, 0, (2, 2, False)), seen(2, 0, (2, 2, True))
    prior = Belief.prior(ROWS, COLS, 6)
    assert prior.merge([clear]).merge([occupied]).known[2, 2] == OCCUPIED
    assert prior.merge([occupied]).merge([clear]).known[2, 2] == OCCUPIED


def test_cells_are_counted_by_observer() -> None:
    belief = Belief.prior(ROWS, COLS, 6).merge(
        [
            seen(7, 0, (0, 0, False), (0, 1, True)),
            seen(7, 4, (0, 1, True), (0, 2, False)),
            seen(9, 1, (0, 0, False)),
        ]
    )
    assert (belief.n_cells_from(7), belief.n_cells_from(9), belief.n_cells_from(8)) == (3, 1, 0)
    assert (belief.n_observed, belief.n_found) == (3, 1)


@pytest.mark.parametrize("cell", [(-1, 0), (0, -1), (ROWS, 0), (0, COLS)])
def test_a_cell_outside_the_area_is_refused_and_nothing_is_merged(cell: tuple[int, int]) -> None:
    prior = Belief.prior(ROWS, COLS, 6)
    with pytest.raises(ValueError, match=r"\b4\b.*\b7\b.*4 × 5"):
        prior.merge([seen(1, 0, (0, 0, True)), seen(7, 3, (*cell, True))])
    assert prior.n_observed == 0


def test_one_name_with_two_contents_is_refused() -> None:
    belief = Belief.prior(ROWS, COLS, 6).merge([seen(7, 3, (0, 0, True))])
    with pytest.raises(ValueError, match=r"\b4\b.*\b7\b"):
        belief.merge([seen(7, 3, (0, 0, False))])


def test_known_cells_are_read_only() -> None:
    for belief in (
        Belief.prior(ROWS, COLS, 6),
        Belief.prior(ROWS, COLS, 6).merge([seen(1, 0, (0, 0, True))]),
    ):
        with pytest.raises(ValueError, match="read-only"):
            belief.known[0, 0] = CLEAR


def test_a_number_of_hostiles_is_any_whole_number() -> None:
    assert Belief.prior(5, 5, np.int64(3)).occupancy() == pytest.approx(Belief.prior(5, 5, 3).occupancy())
    for hostiles in (3.0, "3"):
        with pytest.raises(ValueError, match="hostiles"):
            Belief.prior(5, 5, hostiles)  # type: ignore[arg-type]


@pytest.mark.parametrize(("rows", "cols", "n"), [(0, 5, 0), (5, 5, -1), (5, 5, 26)])
def test_an_impossible_prior_is_refused(rows: int, cols: int, n: int) -> None:
    with pytest.raises(ValueError, match=rf"{rows} × {cols}|\[{n}\]"):
        Belief.prior(rows, cols, n)


# --- checkpoints

sources = st.tuples(st.integers(1, 3), st.integers(0, 1))
logs = st.dictionaries(sources, st.lists(contents, min_size=1, max_size=6), min_size=1, max_size=3).map(
    lambda by_source: {
        (o, i): [Observation(o, n + 1, 0.0, c, i) for n, c in enumerate(observed)]
        for (o, i), observed in by_source.items()
    }
)


@QUICK
@given(logs, st.randoms(use_true_random=False), st.data())
def test_a_checkpoint_replaces_its_observations_in_any_order(log, random, data) -> None:
    everything = [seen for observed in log.values() for seen in observed]
    observations = list(everything)
    for observed in log.values():
        first = None
        for upto in sorted(data.draw(st.sets(st.integers(1, len(observed)), max_size=2))):
            after = 0 if first is None else first.upto
            first = checkpoint(first, observed[after:upto], COLS, ROWS * COLS)
            observations.append(first)
            # Observations of the checkpoint may be missing, or come before or after the checkpoint.
            observations = [s for s in observations if not (s in observed[:upto] and random.random() < 0.5)]
    random.shuffle(observations)
    one_by_one = Belief.prior(ROWS, COLS, 6)
    for item in observations:
        one_by_one = one_by_one.merge([item])
    for belief in (one_by_one, Belief.prior(ROWS, COLS, 6).merge(observations)):
        at_once = Belief.prior(ROWS, COLS, 6).merge(everything)
        np.testing.assert_array_equal(belief.looks, at_once.looks)
        np.testing.assert_array_equal(belief.hits, at_once.hits)
        assert [belief.n_cells_from(n) for n in (1, 2, 3)] == [at_once.n_cells_from(n) for n in (1, 2, 3)]
        assert belief.merge(observations) is belief


def test_a_checkpoint_of_a_whole_area_is_small() -> None:
    cells = tuple((r, c, (r * 7 + c) % 17 == 0) for r in range(200) for c in range(200))
    observed = [Observation(1, n + 1, 0.0, cells[n * 4000 : n * 4000 + 4000]) for n in range(10)]
    made = checkpoint(None, observed, 200, 200 * 200)
    assert made is not None
    assert len(made.packed) < 4000
    merged = Belief.prior(200, 200, 24).merge([made])
    assert merged.n_observed == 40_000
    np.testing.assert_array_equal(merged.hits, Belief.prior(200, 200, 24).merge(observed).hits)


def test_an_invalid_checkpoint_is_refused() -> None:
    belief = Belief.prior(ROWS, COLS, 6)
    outside = checkpoint(None, [Observation(1, 1, 0.0, ((9, 9, True),))], 10, 100)
    assert outside is not None
    for wrong in (
        outside,
        Checkpoint(1, 0, 1, b"nonsense", 0),
        Checkpoint(1, 0, 1, zlib.compress(bytes(12 * 10**5)), 0),
    ):
        with pytest.raises(ValueError, match="checkpoint"):
            belief.merge([wrong])
        assert belief.n_observed == 0
