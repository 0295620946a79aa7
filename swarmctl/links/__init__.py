"""Links: what does the I/O between agents and vehicles. The only sockets of the ground station.

url, base: the forms of a URL, what a link offers; udp, tcp, serial, memory: transports; routing, tlog: which
address a vehicle is at, its log; forward, signing, refusals: who watches, who is believed, who is not;
frontend: owns the transports; direct: one vehicle over the front end; mavsdk: the same, with commands and
missions by MAVSDK; packages: what that needs.
Imports mavlink and core. A new link is one module and one line in `LINKS`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from swarmctl.links.base import Link, LinkError
from swarmctl.links.direct import DirectLink
from swarmctl.links.packages import missing


def _mavsdk_link(*args: Any, **kwargs: Any) -> Link:
    """Raises LinkError where MAVSDK is not installed; whoever does not choose it needs none."""
    if needed := missing("mavsdk"):
        raise LinkError(f"{kwargs['name']}: {needed}")
    link: Link = import_module("swarmctl.links.mavsdk").MavsdkLink(*args, **kwargs)
    return link


LINKS: dict[str, Callable[..., Link]] = {"direct": DirectLink, "mavsdk": _mavsdk_link}
"""by name; each is called like `DirectLink`"""
