"""The belief after any number of observations and checkpoints is that of `Belief.merge`."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.core.belief import Belief
from swarmctl.core.inference.sensor import PERFECT, SensorModel
from swarmctl.core.observation import BeliefItem, Observation, checkpoint
from swarmctl.dashboard.belief_history import BeliefHistory
from swarmctl.dashboard.picture import OWN

SIZE = 4
CELLS = st.tuples(st.integers(0, SIZE - 1), st.integers(0, SIZE - 1), st.booleans())


@st.composite
def received(draw: st.DrawFn) -> list[BeliefItem]:
    """Draw items of two observers in any order, some twice, some replaced by a checkpoint."""
    items: list[BeliefItem] = []
    for observer in (1, 2):
        looks = draw(st.lists(st.lists(CELLS, min_size=1, max_size=3), max_size=6))
        seen = [Observation(observer, i + 1, 0.0, tuple(cells)) for i, cells in enumerate(looks)]
        items += seen
        for upto in draw(st.sets(st.integers(1, max(len(seen), 1)), max_size=2)):
            if upto <= len(seen) and (packed := checkpoint(None, seen[:upto], SIZE, SIZE**2)) is not None:
                items.append(packed)
    again = draw(st.lists(st.sampled_from(items), max_size=3)) if items else []
    return draw(st.permutations([*items, *again]))


@pytest.mark.parametrize("sensor", [PERFECT, SensorModel(0.1, 0.05)])
@given(items=received())
def test_a_history_gives_the_belief_of_each_moment(sensor: SensorModel, items: list[BeliefItem]) -> None:
    prior = Belief.prior(SIZE, SIZE, 5, sensor)
    history, belief, moments = BeliefHistory(prior, 1), prior, [(0.0, prior)]
    for i, item in enumerate(items):
        history.learn(float(i + 1), (item,))
        belief = belief.merge((item,))
        moments.append((float(i + 1), belief))
    for time_s, expected in (*moments, *moments[::-3]):
        found = history.belief(history.version(time_s))
        assert np.array_equal(found.belief.looks, expected.looks)
        assert np.array_equal(found.belief.hits, expected.hits)
        assert found.belief.n_found == expected.n_found
        assert np.count_nonzero(found.codes & OWN) == expected.n_cells_from(1)
