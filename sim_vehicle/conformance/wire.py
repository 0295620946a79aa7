"""What the suite needs of a link: bytes and the vehicle's time."""

from typing import Protocol


class WireError(OSError):
    """The link cannot be opened or is gone; the text says what to do."""


class Wire(Protocol):
    """A link to one vehicle, or to several of which one is followed."""

    def send(self, data: bytes) -> None:
        """Send to the vehicle (to everybody heard, before `follow`)."""

    def receive(self, timeout_s: float) -> bytes | None:
        """The next bytes, waiting for them at most `timeout_s` [s of vehicle time]; None if none came."""

    def now_s(self) -> float:
        """Vehicle time, which only goes forward [s]."""

    def follow(self, sysid: int) -> None:
        """From now on `send` is for this vehicle alone, wherever it was last heard."""

    def close(self) -> None: ...
