"""What is said of frames that are refused: at the first of a kind, and again while that goes on. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from swarmctl.links.signing import AHEAD, LATE, OTHER_KEY, REPEATED, UNSIGNED
from swarmctl.mavlink.telemetry.presence import AUTOPILOT_COMPID

REPEAT_S = 60.0
MEANS = {
    UNSIGNED: "somebody without the key speaks in its name, or it has lost its key",
    OTHER_KEY: "somebody with another key speaks in its name, or it was given another",
    LATE: "its clock is behind; it learns the time from what it is sent",
    AHEAD: "its clock is wrong, or this machine's",
    REPEATED: "something on the way repeats frames, or somebody who has recorded them",
}
"""what it means that frames in a vehicle's name are refused for this"""


@dataclass(slots=True)
class _Kind:
    n: int
    said_s: float


class Refusals:
    """Of one place where frames come in. Each returns what is to be said now; empty where nothing is."""

    def __init__(self) -> None:
        self._kinds: dict[tuple[int, str], _Kind] = {}
        """by a vehicle of ours and the reason. Of strangers, 0, all together: a name is easily claimed, and
        many would fill the memory"""

    def of_vehicle(self, sysid: int, component: int, why: str, address: str, now_s: float) -> str:
        """Of a frame in the name of one that is flown here."""
        n = self._note(sysid, why, now_s)
        of = "" if component == AUTOPILOT_COMPID else f" of component {component}"
        so_far = f"{n} so far, the last{of} from {address}"
        return f"frames in its name are refused, {why} ({so_far}): {MEANS[why]}" if n else ""

    def of_stranger(self, sysid: int, why: str, address: str, now_s: float) -> str:
        n = self._note(0, why, now_s)
        return f"frames are refused, {why} ({n} so far, the last of system {sysid} at {address})" if n else ""

    def _note(self, whose: int, why: str, now_s: float) -> int:
        """One more; how many there have been of its kind, where that is to be said now, else 0."""
        kind = self._kinds.get((whose, why))
        if kind is None:
            self._kinds[whose, why] = _Kind(1, now_s)
            return 1
        kind.n += 1
        if now_s - kind.said_s < REPEAT_S:
            return 0
        kind.said_s = now_s
        return kind.n
