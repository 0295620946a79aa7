"""Links: what does the I/O between agents and vehicles. The only sockets of the ground station.

url, base: the forms of a URL, what a link offers; udp, tcp, serial, memory: transports; routing, tlog: which
address a vehicle is at, its log; frontend: owns the transports; direct: one vehicle over the front end.
Imports mavlink and core. A new link is one module and one line in `LINKS`.
"""

from __future__ import annotations

from collections.abc import Callable

from swarmctl.links.base import Link
from swarmctl.links.direct import DirectLink

LINKS: dict[str, Callable[..., Link]] = {"direct": DirectLink}
"""by name; each is called like `DirectLink`"""
