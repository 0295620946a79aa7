"""Which vehicles are meant: an operator says names or system ids, whichever is at hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

MAX_SAID = 10
"""of what was not found, and of what there is"""


def meant_by(words: Iterable[int | str], names: Mapping[int, str]) -> list[int]:
    """The system ids, each once, in the order of `names` (system id: name).

    Raises ValueError where a word means no vehicle, or two: one by its name, another by its system id.
    """
    found: set[int] = set()
    unknown: list[str] = []
    for word in dict.fromkeys(map(str, words)):
        vehicles = [uav for uav, name in names.items() if word in (str(uav), name)]
        if len(vehicles) > 1:
            raise ValueError(
                f"{word} means two vehicles, {_said(f'{uav} ({names[uav]})' for uav in vehicles)}: "
                "say the one by its name, the other by its system id"
            )
        if not vehicles:
            unknown.append(word)
        found.update(vehicles)
    if unknown:
        there = _said(f"{uav} ({name})" for uav, name in names.items())
        raise ValueError(f"no vehicle has the system id or name {_said(unknown)}; there is {there}")
    return [uav for uav in names if uav in found]


def _said(words: Iterable[str]) -> str:
    all_of_them = list(words)
    more = len(all_of_them) - MAX_SAID
    return ", ".join(all_of_them[:MAX_SAID]) + (f" and {more} more" if more > 0 else "")
