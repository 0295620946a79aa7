"""Events and errors of a link."""

from __future__ import annotations

import msgspec

from swarmctl.mavlink.events import SessionEvent


class AddressChanged(msgspec.Struct, frozen=True):
    """New address of the vehicle, to which the link now sends; a reboot may change a UDP address."""

    address: str


class SystemIdConflict(msgspec.Struct, frozen=True):
    """Two senders with this system id at the same time; frames of the second sender are dropped."""

    address: str
    """address of the second sender"""


class FramesRefused(msgspec.Struct, frozen=True):
    """Refused frames with the vehicle's system id; for each reason at most one event a minute."""

    text: str
    """reason of the refusals, number of frames so far, last sender, and meaning for the operator"""


ChannelEvent = AddressChanged | SystemIdConflict | FramesRefused
"""event about one vehicle from the `FrontEnd`, the owner of the transports"""
LinkEvent = SessionEvent | ChannelEvent


class LinkError(Exception):
    """Failure of a link, a transport, forwarding or signing; the text names the subject."""


class TransportError(LinkError):
    """A port in use, a missing device or an unreachable address."""


class NoAnswer(LinkError):
    """No heartbeat, or no AUTOPILOT_VERSION, has arrived from this system id."""

    def __init__(self, text: str, *, url: str, sysid: int, tried_s: float) -> None:
        super().__init__(text)
        self.url = url
        self.sysid = sysid
        self.tried_s = tried_s


class UnsupportedVehicle(LinkError):
    """The vehicle answers, but its autopilot or its type is not supported."""


class PrepareFailed(LinkError):
    """The vehicle is already armed, or another command has interrupted the preparation."""


class NotReady(LinkError):
    """The vehicle did not become ready to arm in time."""

    def __init__(self, text: str, *, reasons: tuple[str, ...]) -> None:
        super().__init__(text)
        self.reasons = reasons


class UploadFailed(LinkError):
    """The plan is not verified on the vehicle."""


class LaunchFailed(LinkError):
    """The take-off is not confirmed; a vehicle that did not leave the ground may still be armed."""


class CommandFailed(LinkError):
    """A command in flight is not confirmed, or another command has interrupted it."""


class Busy(LinkError):
    """Another procedure runs on this vehicle."""
