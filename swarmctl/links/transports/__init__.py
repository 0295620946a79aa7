"""Transports of bytes: UDP, TCP, serial, and memory for a virtual clock.

Each transport implements `base.Transport`. A new transport is a module here, a line in `TRANSPORTS`, and a
line in `URL_FORMS` of `swarmctl.links.url`.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from swarmctl.links.transports.base import Transport
from swarmctl.links.transports.serial import SerialPort
from swarmctl.links.transports.tcp import TcpClient, TcpServer
from swarmctl.links.transports.udp import Udp
from swarmctl.links.url import Endpoint


class TransportKind(msgspec.Struct, frozen=True):
    """The transport for one kind of endpoint."""

    transport: Callable[[Endpoint], Transport] | None
    """constructor; None for `memory`: the front end has the wires"""
    check: str
    """question to the operator if the vehicle does not answer"""


TRANSPORTS: dict[str, TransportKind] = {
    "udpin": TransportKind(
        Udp, "is the vehicle (or simulator) switched on, and does it send to this machine and port?"
    ),
    "udpout": TransportKind(
        Udp,
        "does the vehicle listen at that host and port? PX4 answers only the first sender after its boot; "
        "use udpin:// and reboot PX4",
    ),
    "tcpin": TransportKind(TcpServer, "does the vehicle connect to this machine and port?"),
    "tcpout": TransportKind(TcpClient, "does the vehicle listen at that host and port?"),
    "serial": TransportKind(
        SerialPort, "is the vehicle switched on, and are the baud rate and the cable right?"
    ),
    "memory": TransportKind(None, "does the simulator have this system id?"),
}
