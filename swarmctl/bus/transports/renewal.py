"""Renewal of a Zenoh session that has no link, or in a mesh a link without routes, for some seconds.

In a mesh the routes to a neighbour may stay lost although the link is up. A Zenoh router announces its
subscriptions only once. When a network heals, this announcement may be lost: its sender is not known yet, or
the other end has closed the session. Only a new node id repairs this, and a new session has a new id. The
node that misses the routes renews its session first. If the routes are still missing, the node requests a
renewal from the neighbour.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping

LinkEnds = tuple[str, str]
"""(own address, address of the other end)"""
Subscribe = Callable[[str], Callable[[], None]]
"""function that subscribes to a key and returns a function to end the subscription"""

LOST_AFTER_S = 3.0
"""Time without any link after which a patient session is replaced. After a cut, Zenoh may need 10 s to close
a TLS link with a full send buffer, and makes no new link in that time."""
MIN_ROUTE_WAIT_S, MAX_ROUTE_WAIT_S = 2.0, 4.0
"""limits of the wait for the routes of a link; routes mostly arrive within milliseconds"""
MAX_DOUBLINGS = 4
"""largest number of doublings of the wait; each renewal doubles the wait, so permanent faults disturb less"""
RESET_AFTER_S = 10.0
"""time with the routes to all neighbours after which the wait is no longer doubled"""
MISSED = ""
"""value in place of a neighbour's id: a neighbour has no routes to this node"""


class LinkSet:
    """The links of a session, from events of several threads.

    Zenoh does not report the end of some links. A link that starts during a subscription with history is
    reported twice.
    """

    def __init__(self) -> None:
        self._known: dict[LinkEnds, object] = {}
        """token of each link; single operations on a dict are atomic"""
        self._missing_once: set[LinkEnds] = set()
        self._alone_since_s: float | None = None

    def __len__(self) -> int:
        return len(self._known)

    def record(self, ends: LinkEnds, *, has_started: bool) -> bool:
        """Record the start (`has_started`) or end of a link; return whether this event is new."""
        if not has_started:
            return self._known.pop(ends, None) is not None
        token = object()
        return self._known.setdefault(ends, token) is token

    def remove_unlisted(self, links: Iterable[LinkEnds]) -> None:
        """Remove links that are missing in `links`, the full list, in two calls in a row.

        A single list may lack a link that has just started.
        """
        missing = self._known.copy().keys() - set(links)
        for ends in missing & self._missing_once:
            self._known.pop(ends, None)
        self._missing_once = missing

    def are_lost(self, now_s: float) -> bool:
        """Return whether all calls in the last `LOST_AFTER_S` or longer found no link."""
        if self._known or self._alone_since_s is None:
            self._alone_since_s = now_s
        return now_s - self._alone_since_s >= LOST_AFTER_S


class Renewal:
    """Renewals of one mesh node, over all its sessions. A node's id is the id of its session."""

    def __init__(self) -> None:
        self._missing_since_s: dict[str, float] = {}
        self._renewed_for: set[str] = set()
        self._n_renewals = 0
        self._complete_since_s: float | None = None

    def is_due(self, own_id: str, routed: Mapping[str, bool], now_s: float, *, is_missed: bool) -> bool:
        """Return whether to renew the session now.

        own_id: id of this node, hexadecimal
        routed: for each linked neighbour, True if this node has routes to the neighbour
        now_s: monotonic time [s]
        is_missed: True if a neighbour still lacks routes after its own renewal, and requests a renewal here
        """
        self._reset_if_complete(now_s, is_complete=bool(routed) and all(routed.values()) and not is_missed)
        missing = {node for node, is_routed in routed.items() if not is_routed} - self._renewed_for
        if is_missed:
            missing.add(MISSED)
        self._missing_since_s = {node: self._missing_since_s.get(node, now_s) for node in missing}
        until_s = now_s - route_wait_s(own_id) * 2 ** min(self._n_renewals, MAX_DOUBLINGS)
        if all(since_s > until_s for since_s in self._missing_since_s.values()):
            return False
        self._renewed_for |= missing - {MISSED}
        self._n_renewals += 1
        self._missing_since_s.clear()
        return True

    def unrepaired(self, routed: Mapping[str, bool]) -> set[str]:
        """Return the neighbours without routes even after a renewal here: they have to renew too."""
        return {node for node, is_routed in routed.items() if not is_routed and node in self._renewed_for}

    def _reset_if_complete(self, now_s: float, *, is_complete: bool) -> None:
        if not is_complete or self._complete_since_s is None:
            self._complete_since_s = now_s if is_complete else None
        elif now_s - self._complete_since_s >= RESET_AFTER_S:
            self._n_renewals = 0
            self._renewed_for.clear()


def route_wait_s(own_id: str) -> float:
    """Return the wait for routes [s]; it depends on the random id, so that nodes rarely renew together."""
    return MIN_ROUTE_WAIT_S + (MAX_ROUTE_WAIT_S - MIN_ROUTE_WAIT_S) * int(own_id[:4], 16) / 0xFFFF


class MeshNeighbours:
    """The neighbours of one session in a mesh, and the check of the routes to these neighbours.

    Each node subscribes to `NODES/ID` with its session's id. If a renewal has not repaired the routes to a
    linked neighbour, the node also subscribes to `NODES/ID/missed` with the neighbour's id. No message is
    put under these keys: `has_subscriber` returns whether another node subscribes to a key.
    """

    def __init__(
        self, nodes: str, own_id: str, subscribe: Subscribe, has_subscriber: Callable[[str], bool]
    ) -> None:
        self._nodes = nodes
        self._subscribe = subscribe
        self._has_subscriber = has_subscriber
        self._missed: dict[str, Callable[[], None]] = {}
        self._own_id = own_id
        subscribe(f"{nodes}/{own_id}")

    def has_to_renew(self, renewal: Renewal, linked: Collection[str], now_s: float) -> bool:
        """Update the requests to neighbours; return whether this node has to renew its session.

        `linked` are the ids of the nodes with a link.
        """
        routed = {node: self._has_subscriber(f"{self._nodes}/{node}") for node in linked}
        self._update_missed(renewal.unrepaired(routed))
        is_missed = self._has_subscriber(self._missed_key(self._own_id))
        return renewal.is_due(self._own_id, routed, now_s, is_missed=is_missed)

    def _update_missed(self, ids: set[str]) -> None:
        for node in self._missed.keys() - ids:
            self._missed.pop(node)()
        for node in ids - self._missed.keys():
            self._missed[node] = self._subscribe(self._missed_key(node))

    def _missed_key(self, node: str) -> str:
        return f"{self._nodes}/{node}/missed"
