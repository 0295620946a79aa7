import math

import numpy as np
import pytest

from swarmctl.core.threat import FiringStrength


def test_eq_1_falls_from_the_middle_to_the_diagonals() -> None:
    np.testing.assert_array_equal(
        FiringStrength(1.0, 0.3, 0.0).kernel, [[0.0, 0.3, 0.0], [0.3, 1.0, 0.3], [0.0, 0.3, 0.0]]
    )


@pytest.mark.parametrize(
    "strengths",
    [
        (0.3, 0.3, 0.1),
        (0.6, 0.1, 0.1),
        (1.1, 0.3, 0.1),
        (0.6, 0.3, -0.1),
        (math.nan, 0.3, 0.1),
    ],
)
def test_other_strengths_are_refused_with_their_value(strengths: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=f"{strengths[0]}.*{strengths[1]}.*{strengths[2]}"):
        FiringStrength(*strengths)
