"""The links of a session as its events tell them, which leave out how some of them end."""

from __future__ import annotations

from collections.abc import Iterable

Ends = tuple[str, str]
"""where a link begins and where it ends"""


class LinkSet:
    """Told of by several threads at once."""

    def __init__(self) -> None:
        self._known: set[Ends] = set()
        self._doubted: set[Ends] = set()
        self._alone_since_s: float | None = None

    def __len__(self) -> int:
        return len(self._known)

    def changed(self, ends: Ends, *, has_come: bool) -> None:
        (self._known.add if has_come else self._known.discard)(ends)

    def listed(self, there: Iterable[Ends]) -> None:
        """What a list of all links says: who is missing in two that follow each other has gone.

        One may miss a link that has just come.
        """
        missing = self._known.copy()
        missing.difference_update(there)
        self._known.difference_update(missing & self._doubted)
        self._doubted = missing

    def alone_s(self, now_s: float) -> float:
        """For how long there has been none, as often as that is asked."""
        if self._known or self._alone_since_s is None:
            self._alone_since_s = now_s
        return now_s - self._alone_since_s
