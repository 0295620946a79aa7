"""Where a bus is listened for or joined, as Zenoh writes it: `tcp/HOST:PORT`."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass, replace

_FORM = re.compile(r"tcp/(?:\[(?P<v6>[0-9A-Fa-f:.]+)\]|(?P<host>[A-Za-z0-9_.-]+)):(?P<port>[0-9]{1,5})")


@dataclass(frozen=True, slots=True)
class BusEndpoint:
    """A TCP address; port 0 is any free one."""

    host: str
    port: int

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine reaches it; a name other than localhost is not asked for."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    @property
    def reachable(self) -> BusEndpoint:
        """Where somebody on this machine finds who listens here."""
        return replace(self, host={"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host))

    def __str__(self) -> str:
        return f"tcp/[{self.host}]:{self.port}" if ":" in self.host else f"tcp/{self.host}:{self.port}"


def parse_endpoint(text: str) -> BusEndpoint:
    """Raises ValueError, saying what is expected."""
    found = _FORM.fullmatch(text)
    if found is None or int(found["port"]) > 65535:
        raise ValueError(f"{text!r} is no endpoint of the bus: expected tcp/HOST:PORT, as tcp/127.0.0.1:7447")
    return BusEndpoint(found["v6"] or found["host"], int(found["port"]))
