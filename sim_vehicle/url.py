"""Where the fleet talks: `udpout:127.0.0.1:14550`, `udpin`, `tcpin`, `tcpout`, with or without `//`."""

import re
from dataclasses import dataclass

FORMS = "udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT or tcpout:HOST:PORT"
_URL = re.compile(r"(?P<kind>[a-z]+):(?://)?(?P<host>[^:/]*):(?P<port>\d+)/?")
KINDS = ("udpout", "udpin", "tcpin", "tcpout")


class UrlError(ValueError):
    """The URL cannot be used; the text says what was expected."""


@dataclass(frozen=True, slots=True)
class Url:
    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind} {self.host}:{self.port}"

    @property
    def udp(self) -> bool:
        return self.kind.startswith("udp")

    @property
    def listens(self) -> bool:
        return self.kind.endswith("in")


def parse_url(text: str) -> Url:
    """Parse one of the forms; UrlError otherwise."""
    match = _URL.fullmatch(text.strip())
    if match is None or match["kind"] not in KINDS:
        raise UrlError(f"--url {text!r} is not understood; expected {FORMS}")
    port = int(match["port"])
    if not 0 < port < 65_536:
        raise UrlError(f"--url {text!r}: port {port} is not between 1 and 65535")
    host = match["host"] or ("0.0.0.0" if match["kind"].endswith("in") else "127.0.0.1")
    return Url(match["kind"], host, port)
