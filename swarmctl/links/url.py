"""URLs of links in the forms of MAVSDK and pymavlink, parsed to an `Endpoint`."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

DEFAULT_BAUD = 57600


class Endpoint(msgspec.Struct, frozen=True):
    """Endpoint of vehicles or of other stations. Vehicles at equal endpoints share one transport."""

    kind: str
    """name of its `UrlForm` in `URL_FORMS`"""
    host: str = ""
    """host name or address; the device path of a serial port; the name of a memory wire"""
    port: int = 0
    baud: int = 0

    @property
    def listens(self) -> bool:
        return URL_FORMS[self.kind].listens

    @property
    def is_wire(self) -> bool:
        """Return whether only the machine at the other end reaches the endpoint, as on a serial line."""
        return URL_FORMS[self.kind].is_wire

    def __str__(self) -> str:
        return URL_FORMS[self.kind].text(self)


class BadUrl(ValueError):
    """An invalid URL of a link; the text names the fault and lists the forms."""

    def __init__(self, url: str, problem: str) -> None:
        super().__init__(f"{url!r} is not a URL of a link: {problem}; write one of: {_forms()}")


def parse_url(url: str) -> Endpoint:
    """Return the endpoint of a URL. Raises BadUrl."""
    text = url.strip()
    if not text:
        raise BadUrl(url, f"expected a URL, found {text!r}")
    if text.startswith("/dev/"):
        return _serial(url, "serial", text if "," in text else f"{text},")
    scheme, colon, rest = text.partition(":")
    scheme = scheme.lower()
    if not colon:
        raise BadUrl(url, f"expected a scheme such as udpin://, found {text!r}")
    scheme = _ALIASES.get(scheme, scheme)
    if scheme not in URL_FORMS:
        raise BadUrl(url, f"expected a known scheme, found {scheme!r}")
    return URL_FORMS[scheme].parse(url, scheme, rest.removeprefix("//"))


def _memory(url: str, kind: str, rest: str) -> Endpoint:
    if not rest:
        raise BadUrl(url, f"expected a name after memory:, found {rest!r}")
    return Endpoint(kind, rest)


def _serial(url: str, kind: str, rest: str) -> Endpoint:
    device, _, baud = rest.partition("," if "," in rest else ":")
    if not device.startswith("/"):
        raise BadUrl(url, f"expected a device path such as /dev/ttyUSB0, found {device!r}")
    if not baud:
        return Endpoint(kind, device, baud=DEFAULT_BAUD)
    if not (baud.isascii() and baud.isdigit() and int(baud) > 0):
        raise BadUrl(url, f"expected a baud rate such as 57600, found {baud!r}")
    return Endpoint(kind, device, baud=int(baud))


def _network(url: str, kind: str, rest: str) -> Endpoint:
    host, colon, port = rest.rpartition(":")
    if not colon:
        raise BadUrl(url, f"expected HOST:PORT, found {rest!r}")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif any(c in host for c in ":/[]@ "):
        raise BadUrl(url, f"expected a host name or address, found {host!r}")
    # With port 0 the system chooses a free port; only a listener can use that.
    listens = URL_FORMS[kind].listens
    lowest = 0 if listens else 1
    if not (port.isascii() and port.isdigit() and lowest <= int(port) <= 65535):
        raise BadUrl(url, f"expected a port between {lowest} and 65535, found {port!r}")
    if not host:
        if not listens:
            raise BadUrl(url, f"expected HOST:PORT to connect to, found {rest!r}")
        host = "0.0.0.0"
    return Endpoint(kind, host, int(port))


def _network_text(endpoint: Endpoint) -> str:
    host = f"[{endpoint.host}]" if ":" in endpoint.host else endpoint.host
    return f"{endpoint.kind}://{host}:{endpoint.port}"


class UrlForm(msgspec.Struct, frozen=True):
    """The form of a URL of one kind of endpoint."""

    example: str
    parse: Callable[[str, str, str], Endpoint] = _network
    """(URL, kind, rest after the scheme) -> endpoint. Raises BadUrl"""
    text: Callable[[Endpoint], str] = _network_text
    listens: bool = False
    is_wire: bool = False


URL_FORMS: dict[str, UrlForm] = {
    "udpin": UrlForm("udpin://0.0.0.0:14550", listens=True),
    "udpout": UrlForm("udpout://HOST:PORT"),
    "tcpin": UrlForm("tcpin://HOST:PORT", listens=True),
    "tcpout": UrlForm("tcpout://HOST:PORT"),
    "serial": UrlForm(
        "serial:///dev/ttyUSB0:57600 or /dev/ttyUSB0,57600",
        _serial,
        lambda endpoint: f"serial://{endpoint.host}:{endpoint.baud}",
        is_wire=True,
    ),
    "memory": UrlForm("memory:NAME", _memory, lambda endpoint: f"memory:{endpoint.host}", is_wire=True),
}
# MAVSDK and pymavlink read a bare udp as "listen here" and a bare tcp as "connect there".
_ALIASES = {"udp": "udpin", "tcp": "tcpout"}


def _forms() -> str:
    aliases = ("udp:HOST:PORT or udp://:PORT (listens)", "tcp:HOST:PORT (connects)")
    return ", ".join((*(form.example for form in URL_FORMS.values()), *aliases))
