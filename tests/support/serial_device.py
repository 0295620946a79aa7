"""A serial device that a test can plug in and pull out."""

import os
import tty
from pathlib import Path


class SerialDevice:
    """A pseudo-terminal behind the symbolic link `name`.

    Another test may reuse the number of a closed terminal; a separate link avoids a mix-up.
    """

    def __init__(self, name: Path) -> None:
        self.name = name
        self._ends: tuple[int, ...] = ()

    def plug_in(self) -> int:
        """Connect a new terminal and return the test's end."""
        own_end, device_end = self._ends = os.openpty()
        tty.setraw(own_end)
        tty.setraw(device_end)
        self.name.symlink_to(os.ttyname(device_end))
        return own_end

    def pull(self) -> None:
        self.name.unlink()  # before the close, so that the number is not found
        for end in self._ends:
            os.close(end)
