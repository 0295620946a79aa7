"""URLs of links, such as `udpout:127.0.0.1:14550`, `tcpin://0.0.0.0:5760`, `serial:/dev/ttyUSB0:57600`."""

import re
from dataclasses import dataclass

FORMS = "udpout:HOST:PORT, udpin:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or serial:DEVICE:BAUD"
NETWORK_KINDS = ("udpout", "udpin", "tcpin", "tcpout")
_ALIASES = {"tcp": "tcpout", "tcpclient": "tcpout", "tcpserver": "tcpin", "": "udpout"}
_AMBIGUOUS = {"udp": "use udpout:HOST:PORT to send, or udpin:HOST:PORT to listen"}
_NETWORK = re.compile(r"(?:(?P<kind>[a-z]+):(?://)?)?(?P<host>\[[^\]\s]*\]|[^:/\[\]\s]*):(?P<port>\d+)/?")
_SERIAL = re.compile(r"serial:(?://(?=/))?(?P<device>[^:\s]+):(?P<baud>\d+)")
MAX_PORT = 65_535
MAX_BAUD = 12_500_000


class UrlError(ValueError):
    """An unusable URL; the text has the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class Url:
    """The URL of a link; for a serial line `host` is the device and `port` the baud rate."""

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.kind} {f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"

    @property
    def is_udp(self) -> bool:
        return self.kind.startswith("udp")

    @property
    def is_serial(self) -> bool:
        return self.kind == "serial"

    @property
    def listens(self) -> bool:
        return self.kind.endswith("in")


def parse_url(text: str) -> Url:
    """Return the URL of a text; `tcp:` means tcpout, HOST:PORT alone means udpout. Raises UrlError."""
    stripped = text.strip()
    if stripped.startswith("serial:"):
        return _serial(stripped, text)
    match = _NETWORK.fullmatch(stripped)
    kind = "" if match is None or match["kind"] is None else match["kind"]
    if kind in _AMBIGUOUS:
        raise UrlError(f"URL {text!r}: {kind} is ambiguous; {_AMBIGUOUS[kind]}")
    kind = _ALIASES.get(kind, kind)
    if match is None or kind not in NETWORK_KINDS or not (match["kind"] or match["host"]):
        raise UrlError(f"URL {text!r}: unknown form; expected {FORMS}")
    port = int(match["port"])
    if not 0 < port <= MAX_PORT:
        raise UrlError(f"URL {text!r}: port {port} is out of range; use 1 to {MAX_PORT}")
    host = match["host"].strip("[]") or ("0.0.0.0" if kind.endswith("in") else "127.0.0.1")
    return Url(kind, host, port)


def _serial(stripped: str, text: str) -> Url:
    match = _SERIAL.fullmatch(stripped)
    if match is None:
        raise UrlError(
            f"URL {text!r}: unknown form; expected serial:DEVICE:BAUD, for example serial:/dev/ttyUSB0:57600"
        )
    baud = int(match["baud"])
    if not 0 < baud <= MAX_BAUD:
        raise UrlError(f"URL {text!r}: {baud} baud is out of range; use 1 to {MAX_BAUD} baud")
    return Url("serial", match["device"], baud)
