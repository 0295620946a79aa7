"""A serial device that a test plugs in and pulls out."""

import os
import tty
from pathlib import Path


class SerialDevice:
    """`name` is a link of the test's own to a pseudo-terminal.

    The terminal's number is free again once it is closed: who opens a device again when it is back would
    open, by that number, whatever another test has just been given.
    """

    def __init__(self, name: Path) -> None:
        self.name = name
        self._ends: tuple[int, ...] = ()

    def plug_in(self) -> int:
        """The end that is not the device's."""
        ours, theirs = self._ends = os.openpty()
        tty.setraw(ours)
        tty.setraw(theirs)
        self.name.symlink_to(os.ttyname(theirs))
        return ours

    def pull(self) -> None:
        self.name.unlink()  # first: from then on nobody finds the number
        for end in self._ends:
            os.close(end)
