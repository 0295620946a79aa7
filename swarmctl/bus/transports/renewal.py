"""Decides when a bus replaces its Zenoh session: no link for long, or a link without routes in a mesh.

In a mesh the routes to a neighbour may stay lost although the link to it is up. Zenoh's routers tell each
other only once which keys they subscribe to. When a network heals, that message may arrive before its sender
is known and be dropped, or go to a session that the other end has given up. Only a new node id repairs this,
and a new session has one. The node that misses the routes renews its session first. If that did not help, it
asks the neighbour to renew its own.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

LinkEnds = tuple[str, str]
"""(own address, address of the other end)"""
Subscribe = Callable[[str], Callable[[], None]]
"""subscribes to a key, and returns a function that ends the subscription"""

EARLIEST_S, LATEST_S = 2.0, 4.0
"""limits of the time for which a link may have no routes [s]; routes mostly arrive within milliseconds"""
MAX_DOUBLINGS = 4
"""greatest number of doublings of that time, one a renewal, so that a permanent fault disturbs less"""
WHOLE_AFTER_S = 10.0
"""time without a missing route, after which the doublings start again"""
MISSED = ""
"""value in place of a node's id: another node misses this node"""


class LinkSet:
    """The links of a session, from events of several threads.

    Zenoh leaves out the end of some links. It reports a link twice that comes up while its events are
    subscribed to with history.
    """

    def __init__(self) -> None:
        self._known: dict[LinkEnds, object] = {}
        """a token for each link; single operations on it are atomic"""
        self._doubted: set[LinkEnds] = set()
        self._alone_since_s: float | None = None

    def __len__(self) -> int:
        return len(self._known)

    def changed(self, ends: LinkEnds, *, has_come: bool) -> bool:
        """Record an event; return False if it adds nothing new."""
        if not has_come:
            return self._known.pop(ends, None) is not None
        token = object()
        return self._known.setdefault(ends, token) is token

    def listed(self, listed: Iterable[LinkEnds]) -> None:
        """Compare with a full list; a link that is missing in two lists in a row has ended.

        A single list may miss a link that has just come up.
        """
        missing = self._known.copy().keys() - set(listed)
        for ends in missing & self._doubted:
            self._known.pop(ends, None)
        self._doubted = missing

    def alone_s(self, now_s: float) -> float:
        """Return the time since the first call without any link [s]."""
        if self._known or self._alone_since_s is None:
            self._alone_since_s = now_s
        return now_s - self._alone_since_s


class Renewal:
    """Renewals of one mesh node, over all its sessions. The ids of nodes are those of their sessions."""

    def __init__(self) -> None:
        self._since_s: dict[str, float] = {}
        self._tried: set[str] = set()
        self._n_renewals = 0
        self._whole_since_s: float | None = None

    def is_due(self, own_id: str, routed: Mapping[str, bool], now_s: float, *, is_missed: bool) -> bool:
        """Return whether to renew the session now.

        `own_id` is hexadecimal. `routed` has each linked neighbour, and whether there are routes to it.
        `is_missed`: a neighbour has renewed its session in vain, and asks this node to do so. `now_s` is
        monotonic.
        """
        self._reset_if_whole(now_s, is_whole=bool(routed) and all(routed.values()) and not is_missed)
        waiting = {node for node, is_routed in routed.items() if not is_routed and node not in self._tried}
        if is_missed:
            waiting.add(MISSED)
        self._since_s = {node: self._since_s.get(node, now_s) for node in waiting}
        until_s = now_s - patience_s(own_id) * 2 ** min(self._n_renewals, MAX_DOUBLINGS)
        if all(since_s > until_s for since_s in self._since_s.values()):
            return False
        self._tried |= waiting - {MISSED}
        self._n_renewals += 1
        self._since_s.clear()
        return True

    def in_vain(self, routed: Mapping[str, bool]) -> set[str]:
        """Return the neighbours that have to renew their own sessions."""
        return {node for node, is_routed in routed.items() if not is_routed and node in self._tried}

    def _reset_if_whole(self, now_s: float, *, is_whole: bool) -> None:
        if not is_whole or self._whole_since_s is None:
            self._whole_since_s = now_s if is_whole else None
        elif now_s - self._whole_since_s >= WHOLE_AFTER_S:
            self._n_renewals = 0
            self._tried.clear()


def patience_s(own_id: str) -> float:
    """Return the time to wait for routes, from the random id: two nodes do not always renew together."""
    return EARLIEST_S + (LATEST_S - EARLIEST_S) * int(own_id[:4], 16) / 0xFFFF


class MeshNeighbours:
    """The neighbours of one session in a mesh, and whether there are routes to them.

    Each node subscribes to `NODES/ID`, where ID is its session's id. It also subscribes to `NODES/ID/missed`
    for each neighbour with a link and without routes that its own renewal did not repair. These keys are
    never put: `is_heard` tells whether another node subscribes to one.
    """

    def __init__(
        self, nodes: str, own_id: str, subscribe: Subscribe, is_heard: Callable[[str], bool]
    ) -> None:
        self._nodes = nodes
        self._subscribe = subscribe
        self._is_heard = is_heard
        self._missed: dict[str, Callable[[], None]] = {}
        self._own_id = own_id
        subscribe(f"{nodes}/{own_id}")

    def has_to_renew(self, renewal: Renewal, linked: Collection[str], now_s: float) -> bool:
        """Return whether this node has to renew its session, and update its requests to neighbours.

        `linked` are the ids of the nodes with a link.
        """
        routed = {node: self._is_heard(f"{self._nodes}/{node}") for node in linked}
        self._update_missed(renewal.in_vain(routed))
        is_missed = self._is_heard(self._missed_key(self._own_id))
        return renewal.is_due(self._own_id, routed, now_s, is_missed=is_missed)

    def _update_missed(self, ids: set[str]) -> None:
        for node in self._missed.keys() - ids:
            self._missed.pop(node)()
        for node in ids - self._missed.keys():
            self._missed[node] = self._subscribe(self._missed_key(node))

    def _missed_key(self, node: str) -> str:
        return f"{self._nodes}/{node}/missed"
