"""Links: the I/O between agents and vehicles over MAVLink.

| module | contents |
|---|---|
| `direct` | the interface to one vehicle, by this program's own conversations |
| `base` | events and errors of a link |
| `frontend`, `line` | owner of the transports; one endpoint with its vehicles |
| `mavsdk`, `mavsdk_conversations` | link with commands and missions by MAVSDK |
| `signing`, `forwarding`, `tlog` | MAVLink 2 signatures, copies for other stations, logs |
| `url`, `transports` | forms of a URL; UDP, TCP, serial, memory |

The way of a frame from a vehicle to its agent, and back:

1. `transports` receive bytes, and call `Line.receive` with the sender's address.
2. `Line` finds the frames, checks signatures, and copies the frames to other stations.
3. `Channel`, one for each vehicle of the line, checks the address, writes the tlog, and decodes the message.
4. `DirectLink` passes the message to its `Session` (`mavlink/session.py`), the part without I/O.
5. `Session` answers with messages to send and with events.
6. `DirectLink` sends the messages by `Channel.send`, `Line.send` and the transport. The events go to the
   vehicle's runner (`flight/runner.py`), and from there to the agent.

Imports mavlink and core. A new link is a class derived from `DirectLink` and one line in `LINKS`; its name is
a value of a vehicle's `link`. Begin with `direct`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import msgspec

from swarmctl.links.direct import DirectLink


def _mavsdk_link(*args: Any, **kwargs: Any) -> DirectLink:
    """Return a `MavsdkLink`. Its module loads a native library, so only the first use imports the module."""
    link: DirectLink = import_module("swarmctl.links.mavsdk").MavsdkLink(*args, **kwargs)
    return link


class LinkKind(msgspec.Struct, frozen=True):
    """A kind of link."""

    open: Callable[..., DirectLink]
    """constructor"""
    fits_virtual_clock: bool = True
    flies_planes: bool = True
    sends_set_points: bool = True


LINKS: dict[str, LinkKind] = {
    "direct": LinkKind(DirectLink),
    "mavsdk": LinkKind(_mavsdk_link, fits_virtual_clock=False, flies_planes=False, sends_set_points=False),
}
