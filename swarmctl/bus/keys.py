"""Every key of the bus, in one table: `swarmctl/SWARM/<uav/TO | station>/ACT/KIND/FROM`.

| key after `swarmctl/SWARM/` | from | to | how | payload |
|---|---|---|---|---|
| `uav/TO/inform/observation/FROM` | a UAV | a UAV in its reach | put | a frame: Observation |
| `uav/TO/inform/state/FROM` | a UAV | a UAV in its reach | put | a frame: StateShared |
| `uav/TO/inform/intent/FROM` | a UAV | a UAV in its reach | put | a frame: IntentShared |
| `uav/TO/query-ref/snapshot/FROM` | a UAV | a UAV in its reach | put | a frame: SnapshotAsked |
| `uav/TO/inform/snapshot/FROM` | a UAV that was asked | who asked | put | a frame: Snapshot |
| `uav/TO/inform/relayed/FROM` | a UAV | a UAV in its reach | put | a frame: Relayed |
| `station/inform/state/FROM` | a UAV | ground stations | put | a frame: StateShared |
| `uav/TO/request/weights/operator` | an operator | the UAV's agent | asked | SetWeights; OperatorAnswer |
| `uav/TO/request/order/operator` | an operator | the UAV's agent | asked | GiveOrder; OperatorAnswer |
| `station/request/weights/operator` | an operator | who flies all | asked | SetWeights; OperatorAnswer |
| `station/request/order/operator` | an operator | who flies all | asked | GiveOrder; OperatorAnswer |
| `node/ID`, `node/ID/missed` | nobody | a mesh's node | - | nothing: who subscribes shows that it is there |
| `uav/TO/inform/look/sensor` | a payload, or a person | the UAV's agent | put or asked | JSON |

ACT is one of FIPA's communicative acts. SWARM is the configuration's name, TO and FROM are system ids. A UAV
reads what is sent to it, and writes only keys that end in its own system id. Checkpoints come inside of
Snapshot and Relayed, never under a key of their own.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

ROOT = "swarmctl"
SWARM_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
"""what a swarm may be called: one part of a key, no wildcard; of a file's name, not a hidden one"""
MAX_LENGTH = 200
"""characters of a key: longer than any of this table"""
MAX_DIGITS = 3
"""of a system id"""
Kind = Literal["weights", "order"]
"""of an operator's requests"""
KINDS: tuple[Kind, ...] = ("weights", "order")


@lru_cache(maxsize=65_536)
def uav_message(swarm: str, to: int, act: str, sender: int) -> str:
    """The key under which UAV `sender` says `act` (`inform/state`) to UAV `to`."""
    return f"{ROOT}/{swarm}/uav/{to}/{act}/{sender}"


def to_station(swarm: str, sender: int) -> str:
    """The key under which UAV `sender` tells ground stations its state."""
    return f"{ROOT}/{swarm}/station/inform/state/{sender}"


def inbox(swarm: str, uav: int) -> str:
    """The key expression that matches everything sent to `uav`."""
    return f"{ROOT}/{swarm}/uav/{uav}/**"


def station(swarm: str) -> str:
    """The key expression that matches everything told to ground stations."""
    return f"{ROOT}/{swarm}/station/inform/**"


def request(swarm: str, kind: Kind, uav: int | None = None) -> str:
    """Where an operator asks something of one UAV's agent; None: of who flies the whole swarm."""
    whom = "station" if uav is None else f"uav/{uav}"
    return f"{ROOT}/{swarm}/{whom}/request/{kind}/operator"


def sensor_report(swarm: str, uav: int | Literal["*"]) -> str:
    """Where a payload tells the agent of its vehicle what it sees; `*`: of any vehicle, for access lists."""
    return f"{ROOT}/{swarm}/uav/{uav}/inform/look/sensor"


def sender_of(key: str) -> tuple[int, str] | None:
    """(sender, `inform/state`) of a key by which a UAV says something; None where it names no UAV.

    A put on a wildcard key reaches every inbox and passes a router's deny rules: such a key is nobody's.
    Others choose the key, so nothing is kept of it.
    """
    if len(key) > MAX_LENGTH or is_wild(key):
        return None
    parts = key.split("/")
    sender = parts[-1]
    if len(parts) < 3 or len(sender) > MAX_DIGITS or not (sender.isascii() and sender.isdigit()):
        return None
    return int(sender), "/".join(parts[-3:-1])


def is_wild(key: str) -> bool:
    """Whether a key may mean several."""
    return "*" in key or "$" in key
