"""Endpoints of the bus in Zenoh's notation: `tcp/HOST:PORT`, `tls/...` or `quic/...`."""

from __future__ import annotations

import re

import msgspec

from swarmctl.core import operator_text
from swarmctl.core.records import replace

CERTIFICATE_PROTOCOLS = ("tls", "quic")
"""protocols with certificates on both sides"""
NO_ENDPOINT = "none"
"""value instead of an endpoint: other processes cannot reach the bus"""
_FORM = re.compile(
    r"(?P<protocol>tcp|tls|quic)/"
    r"(?:\[(?P<v6>[0-9A-Fa-f:.]+)\]|(?P<host>[A-Za-z0-9_.-]+)):(?P<port>[0-9]{1,5})"
)


class BusEndpoint(msgspec.Struct, frozen=True):
    """An address and a protocol; port 0 stands for any free port."""

    host: str
    port: int
    protocol: str = "tcp"

    @property
    def is_loopback(self) -> bool:
        """True if only this machine can reach the endpoint."""
        return operator_text.is_loopback(self.host)

    @property
    def is_certified(self) -> bool:
        """True if the endpoint's protocol uses certificates on both sides."""
        return self.protocol in CERTIFICATE_PROTOCOLS

    @property
    def client_endpoint(self) -> BusEndpoint:
        """Endpoint to which a client on this machine connects."""
        return replace(self, host={"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.protocol}/{host}:{self.port}"


def parse_endpoint(text: str) -> BusEndpoint:
    """Return the endpoint that a text describes. Raises ValueError with the expected form."""
    found = _FORM.fullmatch(text)
    if found is None or int(found["port"]) > 65535:
        raise ValueError(
            f"{text!r} is not an endpoint of the bus: expected tcp/HOST:PORT, such as tcp/127.0.0.1:7447; "
            "with certificates tls/HOST:PORT or quic/HOST:PORT"
        )
    return BusEndpoint(found["v6"] or found["host"], int(found["port"]), found["protocol"])
