"""When the fleet's next tick is due: by the wall clock, or when somebody says so."""

import asyncio
import time
from collections.abc import Callable
from typing import Protocol

from sim_vehicle.epoch import EPSILON_S

LAG_REPORTED_S = 1.0
LAG_REPORT_EVERY_S = 10.0
LOOK_S = 0.5  # the longest wait, so that the server can look around
YIELD_S = 0.01  # how long ticks may run without a look at the sockets


class Pace(Protocol):
    """Simulated time is in s since the fleet started, wall time in s of any origin."""

    finished: bool
    """nothing more is going to be due"""

    def start(self) -> None: ...

    async def due(self, tick_s: float) -> bool:
        """Wait until the tick at `tick_s` is due, at most for a moment; whether it is."""

    def now_s(self, done_s: float, tick_s: float) -> float:
        """The simulated time of what comes in now: at or after `done_s` and before `tick_s`."""

    def late_s(self, tick_s: float) -> float:
        """By how much wall time [s] it is now too late for the tick at `tick_s`."""

    @property
    def lost_s(self) -> float:
        """Wall time [s] that was given up because the simulation was too slow."""

    def __str__(self) -> str: ...


class RealTime:
    """`speedup` simulated seconds in each second; says so when the machine is too slow for that."""

    def __init__(self, speedup: float, warn: Callable[[str], None]) -> None:
        self.finished = False
        self.speedup = speedup
        self._warn = warn
        self._lost_s = 0.0
        self._start_s = self._yielded_s = time.monotonic()
        self._reported_s = -LAG_REPORT_EVERY_S

    def __str__(self) -> str:
        return f"{self.speedup:g}x real time"

    @property
    def lost_s(self) -> float:
        return self._lost_s

    def start(self) -> None:
        self._start_s = self._yielded_s = time.monotonic()

    def late_s(self, tick_s: float) -> float:
        return time.monotonic() - self._start_s - self._lost_s - tick_s / self.speedup

    async def due(self, tick_s: float) -> bool:
        late_s = self.late_s(tick_s)
        if late_s < 0:
            await asyncio.sleep(min(-late_s, LOOK_S))
            self._yielded_s = time.monotonic()
            return self.late_s(tick_s) >= 0
        if late_s > LAG_REPORTED_S:
            self._give_up(late_s)
        if time.monotonic() - self._yielded_s > YIELD_S:
            await asyncio.sleep(0)
            self._yielded_s = time.monotonic()
        return True

    def _give_up(self, late_s: float) -> None:
        self._lost_s += late_s
        wall_s = time.monotonic() - self._start_s
        if wall_s - self._reported_s >= LAG_REPORT_EVERY_S:
            self._reported_s = wall_s
            self._warn(
                f"cannot keep up with {self}: {self._lost_s:.1f} s lost so far; "
                "fewer vehicles or a smaller --speedup would help"
            )

    def now_s(self, done_s: float, tick_s: float) -> float:
        return max(done_s, min(tick_s - 1e-6, tick_s + self.late_s(tick_s) * self.speedup))


class ByHand:
    """Time stands still but for the seconds that somebody grants."""

    def __init__(self) -> None:
        self.finished = False
        self._granted_s = 0.0
        self._waiting: list[tuple[float, Callable[[float], None]]] = []
        self._woken = asyncio.Event()

    def __str__(self) -> str:
        return "stepped by hand"

    @property
    def lost_s(self) -> float:
        return 0.0

    def start(self) -> None:
        """Time begins to stand still."""

    def grant(self, seconds: float, done: Callable[[float], None]) -> None:
        """Let `seconds` more pass; then `done` gets the simulated time that was reached."""
        self._granted_s += seconds
        self._waiting.append((self._granted_s, done))
        self._woken.set()

    def finish(self) -> None:
        """Nothing more will be granted; what has been is still run."""
        self._woken.set()
        self._waiting.append((self._granted_s, lambda _: setattr(self, "finished", True)))

    async def due(self, tick_s: float) -> bool:
        while self._waiting and self._waiting[0][0] < tick_s - EPSILON_S:
            at_s, done = self._waiting.pop(0)
            done(at_s)
        if self.finished:
            return False
        if tick_s <= self._granted_s + EPSILON_S:
            await asyncio.sleep(0)  # what comes in meanwhile has its turn between two ticks
            return True
        self._woken.clear()
        try:
            async with asyncio.timeout(LOOK_S):
                await self._woken.wait()
        except TimeoutError:
            pass
        return False

    def now_s(self, done_s: float, tick_s: float) -> float:
        return min(max(done_s, self._granted_s), max(done_s, tick_s - 1e-6))

    def late_s(self, tick_s: float) -> float:
        return 0.0
