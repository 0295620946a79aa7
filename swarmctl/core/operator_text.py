"""Text that operators write or read: names of vehicles and hosts, printable text, messages with a code."""

from __future__ import annotations

import difflib
import ipaddress
import re
from collections.abc import Iterable, Mapping

MAX_LISTED = 10
"""Greatest number of names listed in an error."""

MAX_EXCERPT_CHARS = 400

VEHICLE_NAME = r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,31}$"
"""pattern of a vehicle's name: valid as the name of a file and as the value of an option"""


def printable(text: str) -> str:
    """Return the text with `?` for each unprintable character, such as a terminal's escapes."""
    return "".join(c if c.isprintable() else "?" for c in text)


def excerpt(text: str) -> str:
    """Return the printable beginning of a text that may quote a sender; terminals and files show it."""
    return printable(text[:MAX_EXCERPT_CHARS])


_CODE = re.compile(r" \[[a-z0-9-]+\]$")


def extended(message: str, more: str) -> str:
    """Return the message with `more` before its code, so that the code stays at the end."""
    code = _CODE.search(message)
    return message + more if code is None else f"{message[: code.start()]}{more}{code.group()}"


def is_loopback(host: str) -> bool:
    """Return whether `host` is a loopback address or the name localhost."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def typed_names(text: str) -> list[str]:
    """Return the names that a person has typed, separated by commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def did_you_mean(word: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """Return a question with the most similar known word; "" if none has a similarity of the cutoff."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=cutoff)
    return f"did you mean {close[0]!r}?" if close else ""


def resolve_vehicles(words: Iterable[int | str], names: Mapping[int, str]) -> list[int]:
    """Return the system ids that `words` name, each once, in the order of `names` (system id: name).

    Raises ValueError if a word matches no vehicle, or the name of one vehicle and the system id of another.
    """
    found: set[int] = set()
    unknown: list[str] = []
    for word in dict.fromkeys(map(str, words)):
        vehicles = [uav for uav, name in names.items() if word in (str(uav), name)]
        if len(vehicles) > 1:
            raise ValueError(
                f"{word} is the system id of one vehicle and the name of another: "
                f"{listed(f'{uav} ({names[uav]})' for uav in vehicles)}; select the vehicle by its other "
                "identifier [ambiguous-vehicle]"
            )
        if not vehicles:
            hint = did_you_mean(word, names.values(), cutoff=0.8)  # above that of uav1 and uav2
            unknown.append(f"{word} ({hint})" if hint else word)
        found.update(vehicles)
    if unknown:
        known = listed(f"{uav} ({name})" for uav, name in names.items())
        raise ValueError(
            f"no vehicle has the system id or name {listed(unknown)}; the vehicles are {known} "
            "[unknown-vehicle]"
        )
    return [uav for uav in names if uav in found]


def name_problems(words: Iterable[int | str], names: Mapping[int, str]) -> dict[str, str]:
    """Return the words that do not name exactly one vehicle, each with the reason (`resolve_vehicles`)."""
    problems = {}
    for word in dict.fromkeys(map(str, words)):
        try:
            resolve_vehicles([word], names)
        except ValueError as error:
            problems[word] = str(error)
    return problems


def listed(words: Iterable[str]) -> str:
    """Return the first MAX_LISTED words, and the number of the others."""
    known = list(words)
    more = len(known) - MAX_LISTED
    return ", ".join(known[:MAX_LISTED]) + (f" and {more} more" if more > 0 else "")
