"""The time that one browser shows. Pure: the wall time is an argument."""

from __future__ import annotations

from dataclasses import dataclass

SPEEDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""offered speeds of a replay, as multiples of the run's time"""


@dataclass
class Playback:
    """Position, speed and state of a replay; `is_live`: the newest data are shown."""

    time_s: float = 0.0
    speed: float = 1.0
    is_playing: bool = False
    is_live: bool = False
    _looked_s: float | None = None

    def advance(self, now_s: float, begin_s: float, end_s: float) -> float:
        """Return the time to show at the wall time `now_s`, between `begin_s` and `end_s` of the source."""
        passed_s = 0.0 if self._looked_s is None else max(now_s - self._looked_s, 0.0)
        self._looked_s = now_s
        if self.is_live:
            self.time_s = end_s
        elif self.is_playing:
            self.time_s += self.speed * passed_s
            if self.time_s >= end_s:
                self.time_s, self.is_playing = end_s, False
        self.time_s = min(max(self.time_s, begin_s), end_s)
        return self.time_s

    def seek(self, time_s: float) -> None:
        self.time_s, self.is_live = time_s, False
