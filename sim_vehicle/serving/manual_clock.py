"""The manual clock: `step SECONDS` lines from a file descriptor, answered after these simulated seconds."""

import asyncio
import contextlib
import math
import os
from collections.abc import Callable, Iterator

from sim_vehicle.serving.pace import ManualPace

MAX_LINE_BYTES = 4096
READ_BYTES = 65_536
FORMS = "`step SECONDS` and `quit`"


class ManualClock:
    """A parser of `step` and `quit` lines without I/O, which grants time to a pace."""

    def __init__(self, pace: ManualPace, say: Callable[[str], None], warn: Callable[[str], None]) -> None:
        self._pace, self._say, self._warn = pace, say, warn
        self._rest = b""
        self._over = False

    def feed(self, data: bytes) -> None:
        """Process input bytes in any portions; empty bytes end the input."""
        if not data:
            self._line(self._rest)
            self._quit()
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._line(line)
        if len(self._rest) > MAX_LINE_BYTES:
            self._rest = b""
            self._warn(f"the first {MAX_LINE_BYTES} or more bytes of a line were ignored; expected {FORMS}")

    def _line(self, line: bytes) -> None:
        words = line.decode("utf-8", "replace").split()
        if self._over or not words:
            return
        if words == ["quit"]:
            self._quit()
        elif len(words) == 2 and words[0] == "step" and (seconds := _seconds(words[1])) is not None:
            self._pace.grant(seconds, lambda at_s: self._say(f"at {round(at_s, 9):g}"))
        else:
            self._warn(f"{' '.join(words)!r:.60} is unknown; expected {FORMS}, for example step 0.5")

    def _quit(self) -> None:
        if not self._over:
            self._over = True
            self._pace.finish()


def _seconds(text: str) -> float | None:
    try:
        seconds = float(text)
    except ValueError:
        return None
    return seconds if 0 <= seconds < math.inf else None


@contextlib.contextmanager
def stepped_from(
    descriptor: int, pace: ManualPace, say: Callable[[str], None], warn: Callable[[str], None]
) -> Iterator[None]:
    """Read lines from a file descriptor while the context is open; a regular file is read at once."""
    clock, loop = ManualClock(pace, say, warn), asyncio.get_running_loop()

    def readable() -> None:
        data = os.read(descriptor, READ_BYTES)
        if not data:
            loop.remove_reader(descriptor)
        clock.feed(data)

    try:
        loop.add_reader(descriptor, readable)
    except PermissionError:  # the event loop cannot poll a regular file
        while data := os.read(descriptor, READ_BYTES):
            clock.feed(data)
        clock.feed(b"")
    try:
        yield
    finally:
        with contextlib.suppress(PermissionError, ValueError, OSError):
            loop.remove_reader(descriptor)
