"""The protocol of links, their errors and addresses. Links read the time only from their event loop."""

import errno
import socket
from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from sim_vehicle.links.url import Url

ACTIVE_S = 10.0  # silence after which a ground station on UDP is not counted
RECEIVE_BYTES = 8192  # bytes read at once; the rest of a longer datagram is lost
DATAGRAMS_PER_WAKE, BYTES_PER_WAKE = 64, 16_384  # limits of one UDP callback, so that other sockets get time
RETRY_S = 1.0  # time between two attempts to restore a link (TCP client: `RECONNECT_S`)
SHORTAGES = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})  # descriptors or memory
Address = tuple[Any, ...]  # in the form of the socket module
Batch = Sequence[tuple[int, bytes]]  # (index of the vehicle, whole frames)


class LinkError(OSError):
    """A link that cannot be opened; the text has the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class LinkCallbacks:
    """The functions that a link calls."""

    # receiver of bytes, their peer, and the addressed vehicles (None: all vehicles of the link)
    received: Callable[[bytes, Hashable, Collection[int] | None], None]
    ended: Callable[[Hashable], None]  # receiver of a peer that the link has closed or removed
    warn: Callable[[str], None]  # receiver of a line for the operator


class Link(Protocol):
    """One port and its ground stations; opened and closed within a running event loop."""

    @property
    def dropped(self) -> int:
        """Number of datagrams or chunks dropped for slow receivers."""

    def open(self) -> None:
        """Open the link. Raises LinkError."""

    def send(self, batch: Batch) -> None:
        """Send (vehicle, bytes of whole frames) to every ground station, without blocking."""

    def rebooted(self, index: int) -> None:
        """React to the end of a vehicle's reboot."""

    def stations(self) -> int:
        """Return the number of ground stations (UDP: of peers that sent data within `ACTIVE_S`)."""

    def close(self) -> None: ...


def resolve(url: Url, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Address]:
    """Return the socket family and address of a URL. Raises LinkError for an unknown host."""
    flags = socket.AI_PASSIVE if url.listens else 0
    try:
        found = socket.getaddrinfo(url.host, url.port, type=kind, flags=flags)
    except OSError as error:
        raise LinkError(
            f"{url}: unknown host {url.host!r} ({error.strerror or error}); "
            "check the name, or use an address [unknown-host]"
        ) from error
    family, _, _, _, address = found[0]
    return family, address


def cannot_open(url: Url, error: OSError) -> LinkError:
    """Return the error for a port that cannot be opened."""
    if error.errno == errno.EADDRINUSE:
        cure = "another program may use it; choose another port in the URL [port-in-use]"
    elif error.errno == errno.EADDRNOTAVAIL:
        cure = "this machine has no such address; choose another address in the URL [no-such-address]"
    elif error.errno in (errno.EACCES, errno.EPERM):
        cure = "choose another address, or a port above 1023, in the URL [not-permitted]"
    elif error.errno in (errno.EMFILE, errno.ENFILE):
        cure = "allow more open files (ulimit -n), or use fewer ports [too-many-files]"
    else:
        cure = "check the network, and the address in the URL"
    return LinkError(f"cannot open {url}: {error.strerror or error}; {cure}")
