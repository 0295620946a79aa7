"""The time that a browser shows."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.dashboard.page import Playback


@given(speed=st.floats(0.5, 50.0), looks=st.lists(st.floats(0.0, 5.0), min_size=1, max_size=6))
def test_a_replay_runs_at_its_speed_and_stops_at_the_end(speed: float, looks: list[float]) -> None:
    playback, now_s = Playback(speed=speed, is_playing=True), 100.0
    playback.advance(now_s, 60.0)
    for step_s in looks:
        now_s += step_s
        shown_s = playback.advance(now_s, 60.0)
    assert shown_s == pytest.approx(min(speed * sum(looks), 60.0))
    assert playback.is_playing == (shown_s < 60.0)


def test_a_pause_keeps_the_time_and_a_live_view_follows_the_end() -> None:
    playback = Playback()
    playback.seek(7.0)
    assert [playback.advance(float(t), 60.0) for t in range(3)] == [7.0, 7.0, 7.0]
    playback.is_live = True
    assert [playback.advance(3.0, end_s) for end_s in (60.0, 61.0)] == [60.0, 61.0]
    playback.seek(5.0)
    assert playback.advance(4.0, 62.0) == 5.0
