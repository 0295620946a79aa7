"""The pace of the fleet's ticks: by the wall clock, or on request."""

import asyncio
import time
from collections.abc import Callable
from typing import Protocol

from sim_vehicle.epoch import EPSILON_S

LAG_REPORTED_S = 1.0  # lateness above which the pace skips the lost time and reports it
LAG_REPORT_EVERY_S = 10.0  # shortest time between two reports
LONGEST_WAIT_S = 0.5  # longest wait, so that the server can check its own state
YIELD_S = 0.01  # longest run of ticks before the sockets are read


class Pace(Protocol):
    """The pace of a fleet; simulated time counts from the start [s]."""

    finished: bool  # True after the last tick
    lost_s: float  # wall time skipped because the simulation was too slow [s]

    def start(self) -> None: ...

    async def due(self, tick_s: float) -> bool:
        """Wait at most `LONGEST_WAIT_S` for the tick at `tick_s`; return True if the tick is due."""

    def now_s(self, done_s: float, tick_s: float) -> float:
        """Return the simulated time of input that arrives now [s], from `done_s` to before `tick_s`."""

    def late_s(self, tick_s: float) -> float:
        """Return the delay of the tick at `tick_s` in wall time [s]; negative before the tick is due."""

    def __str__(self) -> str: ...


class RealTime:
    """A pace by the wall clock times `speedup`, with a warning on a slow machine."""

    def __init__(self, speedup: float, warn: Callable[[str], None]) -> None:
        self.finished, self.lost_s = False, 0.0
        self.speedup = speedup
        self._warn = warn
        self._start_s = self._yielded_s = time.monotonic()
        self._reported_s = -LAG_REPORT_EVERY_S

    def __str__(self) -> str:
        return f"{self.speedup:g}x real time"

    def start(self) -> None:
        self._start_s = self._yielded_s = time.monotonic()

    def late_s(self, tick_s: float) -> float:
        return time.monotonic() - self._start_s - self.lost_s - tick_s / self.speedup

    async def due(self, tick_s: float) -> bool:
        late_s = self.late_s(tick_s)
        if late_s < 0:
            await asyncio.sleep(min(-late_s, LONGEST_WAIT_S))
            self._yielded_s = time.monotonic()
            return self.late_s(tick_s) >= 0
        if late_s > LAG_REPORTED_S:
            self._skip_lost_time(late_s)
        if time.monotonic() - self._yielded_s > YIELD_S:
            await asyncio.sleep(0)
            self._yielded_s = time.monotonic()
        return True

    def _skip_lost_time(self, late_s: float) -> None:
        self.lost_s += late_s
        wall_s = time.monotonic() - self._start_s
        if wall_s - self._reported_s >= LAG_REPORT_EVERY_S:
            self._reported_s = wall_s
            self._warn(
                f"the machine is too slow for {self}: {self.lost_s:.1f} s lost so far; "
                "use fewer vehicles or a smaller --speedup [too-slow]"
            )

    def now_s(self, done_s: float, tick_s: float) -> float:
        return max(done_s, min(tick_s - 1e-6, tick_s + self.late_s(tick_s) * self.speedup))


class ManualPace:
    """A pace by request: time passes only after `grant`."""

    def __init__(self) -> None:
        self.finished, self.lost_s = False, 0.0
        self._granted_s = 0.0
        self._waiting: list[tuple[float, Callable[[float], None]]] = []
        self._woken = asyncio.Event()

    def __str__(self) -> str:
        return "manual clock"

    def start(self) -> None:
        """Do nothing: time passes only after a grant."""

    def grant(self, seconds: float, done: Callable[[float], None]) -> None:
        """Let `seconds` more pass, then call `done` with the simulated time [s]."""
        self._granted_s += seconds
        self._waiting.append((self._granted_s, done))
        self._woken.set()

    def finish(self) -> None:
        """End the run after the granted time."""
        self._woken.set()
        self._waiting.append((self._granted_s, lambda _: setattr(self, "finished", True)))

    async def due(self, tick_s: float) -> bool:
        while self._waiting and self._waiting[0][0] < tick_s - EPSILON_S:
            at_s, done = self._waiting.pop(0)
            done(at_s)
        if self.finished:
            return False
        if tick_s <= self._granted_s + EPSILON_S:
            await asyncio.sleep(0)  # input is processed between two ticks
            return True
        self._woken.clear()
        try:
            async with asyncio.timeout(LONGEST_WAIT_S):
                await self._woken.wait()
        except TimeoutError:
            pass
        return False

    def now_s(self, done_s: float, tick_s: float) -> float:
        return min(max(done_s, self._granted_s), max(done_s, tick_s - 1e-6))

    def late_s(self, tick_s: float) -> float:
        return 0.0
