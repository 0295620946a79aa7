"""Changed copies of records."""

from __future__ import annotations

import pytest

from swarmctl.core.records import replace
from swarmctl.core.threat import FiringStrength


def test_a_check_of_the_record_holds_for_its_copies() -> None:
    strength = FiringStrength(0.6, 0.3, 0.1)
    assert replace(strength, direct=0.7) == FiringStrength(0.7, 0.3, 0.1)
    with pytest.raises(ValueError, match="expected"):
        replace(strength, direct=0.2)
