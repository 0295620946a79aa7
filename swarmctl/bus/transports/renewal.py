"""When a node of a mesh begins anew: routes to a neighbour may stay lost although the link to it is there.

Zenoh's routers tell each other once who hears what. Where a network heals, that may come before it is known
who says so and be dropped, or go to a session that the other end has given up. Nothing mends it until one of
the two is another node, which a session that is opened anew is: first of who misses the other, and where that
was in vain, of who is missed.
"""

from __future__ import annotations

from collections.abc import Mapping

EARLIEST_S, LATEST_S = 2.0, 4.0
"""how long a link may be without routes, which mostly come within milliseconds"""
MOST_DOUBLINGS = 4
"""of that time, once for each time of beginning anew: what cannot be mended does not disturb the rest"""
WHOLE_AFTER_S = 10.0
"""without anything missing, the next time is as the first"""
MISSED = ""
"""in place of an id: the node itself is missed by others"""


class Renewal:
    """For one node, through all its sessions. Nodes go by the ids of their present sessions."""

    def __init__(self) -> None:
        self._since_s: dict[str, float] = {}
        self._tried: set[str] = set()
        self._times = 0
        self._whole_since_s: float | None = None

    def is_due(self, own_id: str, routed: Mapping[str, bool], now_s: float, *, is_missed: bool) -> bool:
        """Whether to begin anew.

        `own_id` is hexadecimal; `routed` says of each neighbour to which there is a link whether there are
        routes, `is_missed` whether another has tried in vain and asks us to. `now_s` does not go back.
        """
        self._rest(now_s, is_whole=bool(routed) and all(routed.values()) and not is_missed)
        wanting = {who for who, is_routed in routed.items() if not is_routed and who not in self._tried}
        if is_missed:
            wanting.add(MISSED)
        self._since_s = {who: self._since_s.get(who, now_s) for who in wanting}
        until_s = now_s - patience_s(own_id) * 2 ** min(self._times, MOST_DOUBLINGS)
        if all(since_s > until_s for since_s in self._since_s.values()):
            return False
        self._tried |= wanting - {MISSED}
        self._times += 1
        self._since_s.clear()
        return True

    def in_vain(self, routed: Mapping[str, bool]) -> set[str]:
        """The neighbours that are to begin anew themselves."""
        return {who for who, is_routed in routed.items() if not is_routed and who in self._tried}

    def _rest(self, now_s: float, *, is_whole: bool) -> None:
        if not is_whole or self._whole_since_s is None:
            self._whole_since_s = now_s if is_whole else None
        elif now_s - self._whole_since_s >= WHOLE_AFTER_S:
            self._times = 0
            self._tried.clear()


def patience_s(own_id: str) -> float:
    """By the id, which is drawn at random: two that miss each other do not begin anew at once each time."""
    return EARLIEST_S + (LATEST_S - EARLIEST_S) * int(own_id[:4], 16) / 0xFFFF
