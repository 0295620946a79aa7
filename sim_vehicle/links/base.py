"""What every transport is to the server, and how addresses and errors are read.

The only clock of the links is that of the event loop they were opened in.
"""

import errno
import socket
from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from sim_vehicle.links.url import Url

HEARD_S = 10.0  # a ground station that has not spoken for so long is not counted any more
RECEIVE_BYTES = 8192  # read at once; of a datagram that is longer the rest is lost
DATAGRAMS_PER_WAKE, BYTES_PER_WAKE = 64, 16_384  # read before others, and the clock, have their turn
AGAIN_S = 1.0  # between two attempts to get back what was lost
FULL = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})  # it will be better later
Address = tuple[Any, ...]  # as the socket module has it
Batch = Sequence[tuple[int, bytes]]


class LinkError(OSError):
    """The link cannot be opened; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Ends:
    """Where a link hands over what it gets."""

    received: Callable[[bytes, Hashable, Collection[int] | None], None]
    """bytes, who sent them, and the vehicles that they reach (None: all of the link)"""
    gone: Callable[[Hashable], None]
    """a stream ended; nothing more comes from that sender"""
    warn: Callable[[str], None]
    """a line for the operator"""


class Link(Protocol):
    """One port, and the ground stations that are there; opened and closed within a running event loop."""

    @property
    def dropped(self) -> int:
        """Datagrams or chunks that were not sent because the other end was too slow."""

    def open(self) -> None:
        """Raise LinkError if that cannot be done."""

    def send(self, batch: Batch) -> None:
        """(vehicle, bytes of whole frames) to every ground station that is there; never blocks."""

    def rebooted(self, index: int) -> None:
        """A vehicle has come back from a reboot."""

    def stations(self) -> int:
        """How many ground stations are there."""

    def close(self) -> None: ...


def resolve(url: Url, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Address]:
    """Family and address of a URL's host; LinkError where nobody knows it."""
    flags = socket.AI_PASSIVE if url.listens else 0
    try:
        found = socket.getaddrinfo(url.host, url.port, type=kind, flags=flags)
    except OSError as error:
        raise LinkError(
            f"{url}: the host {url.host!r} is not known ({error.strerror or error}); "
            "check its spelling, or give its address"
        ) from error
    family, _, _, _, address = found[0]
    return family, address


def cannot_open(url: Url, error: OSError) -> LinkError:
    """The error for a port that cannot be had."""
    if error.errno == errno.EADDRINUSE:
        cure = "Is another program using it? Choose another port with --url."
    elif error.errno == errno.EADDRNOTAVAIL:
        cure = "This machine has no such address; choose another one with --url."
    elif error.errno in (errno.EACCES, errno.EPERM):
        cure = "You may not use it; choose another address, or a port above 1023, with --url."
    elif error.errno in (errno.EMFILE, errno.ENFILE):
        cure = "Allow more open files (ulimit -n), or use fewer ports."
    else:
        cure = "Check the network, and the address given with --url."
    return LinkError(f"cannot open {url}: {error.strerror or error}. {cure}")
