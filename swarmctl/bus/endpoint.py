"""Where a bus is listened for or joined, as Zenoh writes it: `tcp/HOST:PORT`, `tls/...` or `quic/...`."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from swarmctl.core import texts

PROTOCOLS = ("tcp", "tls", "quic")
CERTIFICATE_PROTOCOLS = ("tls", "quic")
"""the protocols over which both sides show certificates"""
NO_ENDPOINT = "none"
"""instead of an endpoint to listen at: nobody outside this process reaches the bus"""
_FORM = re.compile(
    r"(?P<protocol>tcp|tls|quic)/"
    r"(?:\[(?P<v6>[0-9A-Fa-f:.]+)\]|(?P<host>[A-Za-z0-9_.-]+)):(?P<port>[0-9]{1,5})"
)


@dataclass(frozen=True, slots=True)
class BusEndpoint:
    """An address on the network; port 0 is any free one."""

    host: str
    port: int
    protocol: str = "tcp"

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine reaches it."""
        return texts.is_loopback(self.host)

    @property
    def is_certified(self) -> bool:
        """Whether both sides show certificates."""
        return self.protocol in CERTIFICATE_PROTOCOLS

    @property
    def reachable(self) -> BusEndpoint:
        """Where somebody on this machine finds who listens here."""
        return replace(self, host={"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol}/{host}:{self.port}"


def parse_endpoint(text: str) -> BusEndpoint:
    """Raises ValueError, saying what is expected."""
    found = _FORM.fullmatch(text)
    if found is None or int(found["port"]) > 65535:
        raise ValueError(
            f"{text!r} is no endpoint of the bus: expected tcp/HOST:PORT, as tcp/127.0.0.1:7447; with "
            "certificates tls/HOST:PORT or quic/HOST:PORT"
        )
    return BusEndpoint(found["v6"] or found["host"], int(found["port"]), found["protocol"])
