"""Which neighbours of a mesh node it has routes to: told by who hears what, under keys where nobody puts."""

from __future__ import annotations

from collections.abc import Callable, Collection

from swarmctl.bus.transports.renewal import Renewal

Hear = Callable[[str], Callable[[], None]]
"""begins to hear what is put under a key; what it returns ends that"""


class MeshNeighbours:
    """Of one session. Every node hears under `NODES/ID`, where ID is its session's, and under
    `NODES/ID/missed` for each other to which it has a link and no routes, and cannot help that."""

    def __init__(self, nodes: str, own_id: str, hear: Hear, is_heard: Callable[[str], bool]) -> None:
        self._nodes = nodes
        self._hear = hear
        self._is_heard = is_heard
        self._missed: dict[str, Callable[[], None]] = {}
        self._own_id = own_id
        hear(f"{nodes}/{own_id}")

    def look(self, renewal: Renewal, linked: Collection[str], now_s: float) -> bool:
        """Whether this node has to begin anew; and ask those to do so for whom it has done so in vain.

        `linked` are the ids of the nodes to which there is a link.
        """
        routed = {who: self._is_heard(f"{self._nodes}/{who}") for who in linked}
        self._miss(renewal.in_vain(routed))
        is_missed = self._is_heard(self._missed_key(self._own_id))
        return renewal.is_due(self._own_id, routed, now_s, is_missed=is_missed)

    def _miss(self, ids: set[str]) -> None:
        for who in self._missed.keys() - ids:
            self._missed.pop(who)()
        for who in ids - self._missed.keys():
            self._missed[who] = self._hear(self._missed_key(who))

    def _missed_key(self, who: str) -> str:
        return f"{self._nodes}/{who}/missed"
