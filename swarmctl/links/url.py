"""URLs of links in the forms of MAVSDK and pymavlink, parsed to an `Endpoint`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["udpin", "udpout", "tcpin", "tcpout", "serial", "memory"]

FORMS = (
    "udpin://0.0.0.0:14550, udpout://HOST:PORT, tcpin://HOST:PORT, tcpout://HOST:PORT, "
    "serial:///dev/ttyUSB0:57600, udp:HOST:PORT or udp://:PORT (listens), tcp:HOST:PORT (connects), "
    "/dev/ttyUSB0,57600, memory:NAME"
)
_NETWORK: dict[str, Kind] = {
    "udpin": "udpin",
    "udpout": "udpout",
    "tcpin": "tcpin",
    "tcpout": "tcpout",
    # MAVSDK and pymavlink read a bare udp as "listen here" and a bare tcp as "connect there".
    "udp": "udpin",
    "tcp": "tcpout",
}
DEFAULT_BAUD = 57600


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Endpoint of vehicles or of other stations. Vehicles at equal endpoints share one transport."""

    kind: Kind
    host: str = ""
    """host name or address; the device path of a serial port; the name of a memory wire"""
    port: int = 0
    baud: int = 0

    @property
    def listens(self) -> bool:
        return self.kind in ("udpin", "tcpin")

    def __str__(self) -> str:
        match self.kind:
            case "serial":
                return f"serial://{self.host}:{self.baud}"
            case "memory":
                return f"memory:{self.host}"
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}://{host}:{self.port}"


class BadUrl(ValueError):
    """An invalid URL of a link; the text names the fault and lists the forms."""

    def __init__(self, url: str, problem: str) -> None:
        super().__init__(f"{url!r} is not a URL of a link: {problem}; write one of: {FORMS}")


def parse_url(url: str) -> Endpoint:
    """Return the endpoint of a URL. Raises BadUrl."""
    text = url.strip()
    if not text:
        raise BadUrl(url, f"expected a URL, found {text!r}")
    if text.startswith("/dev/"):
        device, _, baud = text.partition(",")
        return _serial(url, device, baud)
    scheme, colon, rest = text.partition(":")
    scheme = scheme.lower()
    if not colon:
        raise BadUrl(url, f"expected a scheme such as udpin://, found {text!r}")
    rest = rest.removeprefix("//")
    if scheme == "serial":
        separator = "," if "," in rest else ":"
        device, _, baud = rest.partition(separator)
        return _serial(url, device, baud)
    if scheme == "memory":
        if not rest:
            raise BadUrl(url, f"expected a name after memory:, found {rest!r}")
        return Endpoint("memory", rest)
    if scheme not in _NETWORK:
        raise BadUrl(url, f"expected a known scheme, found {scheme!r}")
    return _network(url, _NETWORK[scheme], rest)


def _serial(url: str, device: str, baud: str) -> Endpoint:
    if not device.startswith("/"):
        raise BadUrl(url, f"expected a device path such as /dev/ttyUSB0, found {device!r}")
    if not baud:
        return Endpoint("serial", device, baud=DEFAULT_BAUD)
    if not (baud.isascii() and baud.isdigit() and int(baud) > 0):
        raise BadUrl(url, f"expected a baud rate such as 57600, found {baud!r}")
    return Endpoint("serial", device, baud=int(baud))


def _network(url: str, kind: Kind, rest: str) -> Endpoint:
    host, colon, port = rest.rpartition(":")
    if not colon:
        raise BadUrl(url, f"expected HOST:PORT, found {rest!r}")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif any(c in host for c in ":/[]@ "):
        raise BadUrl(url, f"expected a host name or address, found {host!r}")
    # With port 0 the system chooses a free port; only a listener can use that.
    lowest = 0 if kind in ("udpin", "tcpin") else 1
    if not (port.isascii() and port.isdigit() and lowest <= int(port) <= 65535):
        raise BadUrl(url, f"expected a port between {lowest} and 65535, found {port!r}")
    if not host:
        if kind not in ("udpin", "tcpin"):
            raise BadUrl(url, f"expected HOST:PORT to connect to, found {rest!r}")
        host = "0.0.0.0"
    return Endpoint(kind, host, int(port))
