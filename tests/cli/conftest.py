"""A flight that several modules read."""

from __future__ import annotations

import pytest
from swarmctl_process import SMALL, CliFlight, fly


@pytest.fixture(scope="session")
def small_flight(tmp_path_factory: pytest.TempPathFactory) -> CliFlight:
    """The flight of `SMALL`. No test changes its run folder."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "small.yaml").write_text(SMALL)
    return fly(folder, "--config", folder / "small.yaml")
