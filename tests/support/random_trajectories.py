"""Trajectories drawn by hypothesis."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from swarmctl.agent.traffic.separation.trajectory import Trajectory

metres = st.integers(-60, 60).map(float)


heights = st.integers(0, 12).map(float)


@st.composite
def flights(draw: st.DrawFn) -> Trajectory:
    points = draw(st.lists(st.tuples(metres, metres, heights), min_size=2, max_size=5))
    lasts_s = draw(st.lists(st.integers(1, 8), min_size=len(points) - 1, max_size=len(points) - 1))
    times_s = np.cumsum([draw(st.integers(0, 6)), *lasts_s])
    return Trajectory(tuple(map(float, times_s)), tuple(points))
