"""Links: the I/O between agents and vehicles over MAVLink.

| module | contents |
|---|---|
| `base` | interface of a link, its events and its errors |
| `frontend`, `line` | owner of the transports; one endpoint with its vehicles |
| `direct` | link by this program's own conversations |
| `mavsdk`, `mavsdk_conversations` | link with commands and missions by MAVSDK |
| `signing`, `forwarding`, `tlog` | MAVLink 2 signatures, copies for other stations, logs |
| `url`, `transports` | forms of a URL; UDP, TCP, serial, memory |

Imports mavlink and core. A new link is one module and one line in `LINKS`; its name is a value of a vehicle's
`link`. Begin with `base` and `direct`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import msgspec

from swarmctl.links.base import Link
from swarmctl.links.direct import DirectLink


def _mavsdk_link(*args: Any, **kwargs: Any) -> Link:
    """Return a `MavsdkLink`. Its module loads a native library, so only the first use imports the module."""
    link: Link = import_module("swarmctl.links.mavsdk").MavsdkLink(*args, **kwargs)
    return link


class LinkKind(msgspec.Struct, frozen=True):
    """A kind of link."""

    open: Callable[..., Link]
    """constructor, with the parameters of `DirectLink`"""
    fits_virtual_clock: bool = True
    flies_planes: bool = True
    sends_set_points: bool = True


LINKS: dict[str, LinkKind] = {
    "direct": LinkKind(DirectLink),
    "mavsdk": LinkKind(_mavsdk_link, fits_virtual_clock=False, flies_planes=False, sends_set_points=False),
}
