"""The keys of the bus: `swarmctl/SWARM/<uav/TO | station>/ACT/KIND/FROM`.

| key after `swarmctl/SWARM/` | from | to | Zenoh operation | payload |
|---|---|---|---|---|
| `uav/TO/inform/observation/FROM` | a UAV | a UAV in range | put | a frame: Observation |
| `uav/TO/inform/state/FROM` | a UAV | a UAV in range, or a silent UAV | put | a frame: StateShared |
| `uav/TO/inform/intent/FROM` | a UAV | a UAV in range | put | a frame: IntentShared |
| `uav/TO/inform/member/FROM` | a UAV | a member of its group in range | put | a frame: MemberShared |
| `uav/TO/query-ref/snapshot/FROM` | a UAV | another UAV | put | a frame: SnapshotAsked |
| `uav/TO/inform/snapshot/FROM` | the UAV with the snapshot | the requesting UAV | put | a frame: Snapshot |
| `uav/TO/inform/relayed/FROM` | a UAV | a UAV in range | put | a frame: Relayed |
| `station/inform/state/FROM` | a UAV | ground stations | put | a frame: StateShared |
| `uav/TO/request/weights/operator` | operator | the UAV's agent | query | SetWeights; reply: VehicleAnswer |
| `uav/TO/request/order/operator` | operator | the UAV's agent | query | GiveOrder; reply: VehicleAnswer |
| `station/propagate/observation/FROM` | a UAV | ground stations | put | a copy of the frame to the UAVs |
| `station/propagate/intent/FROM` | a UAV | ground stations | put | a copy of the frame to the UAVs |
| `station/propagate/member/FROM` | a UAV | ground stations | put | a copy of the frame to the UAVs |
| `station/query-ref/vehicles/operator` | operator | `swarmctl fly` | query | empty; reply: SwarmVehicles |
| `node/ID`, `node/ID/missed` | – | a mesh's node | subscribe | none: the subscription shows presence |
| `uav/TO/inform/look/sensor` | a payload, or a person | the UAV's agent | put or query | JSON |

ACT is one of FIPA's communicative acts. SWARM is the configuration's name; TO and FROM are system ids. A UAV
subscribes to the keys with its own TO, and puts only keys that end in its own system id. Checkpoints travel
inside Snapshot and Relayed, never under a key of their own.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

ROOT = "swarmctl"
SWARM_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
"""pattern of a swarm's name: valid as one part of a key, without wildcards, and as the name of a file"""
MAX_LENGTH = 200
"""greatest length of a key [characters]; all keys of the table are shorter"""
MAX_DIGITS = 3
"""greatest number of digits of a system id"""
RequestKind = Literal["weights", "order"]
"""kind of an operator's request"""
REQUEST_KINDS: tuple[RequestKind, ...] = ("weights", "order")


@lru_cache(maxsize=65_536)
def uav_message(swarm: str, to: int, act: str, sender: int) -> str:
    """Return the key of a message `act` (such as `inform/state`) from UAV `sender` to UAV `to`."""
    return f"{ROOT}/{swarm}/uav/{to}/{act}/{sender}"


def to_station(swarm: str, sender: int) -> str:
    """Return the key of UAV `sender`'s state for ground stations."""
    return f"{ROOT}/{swarm}/station/inform/state/{sender}"


def copy_to_station(swarm: str, act: str, sender: int) -> str:
    """Return the key of a ground stations' copy of UAV `sender`'s message `act`, such as `inform/intent`."""
    return f"{ROOT}/{swarm}/station/propagate/{act.rpartition('/')[2]}/{sender}"


def inbox(swarm: str, uav: int) -> str:
    """Return the key expression that matches every message to `uav`."""
    return f"{ROOT}/{swarm}/uav/{uav}/**"


def station(swarm: str) -> str:
    """Return the key expression that matches the states that UAVs send to ground stations."""
    return f"{ROOT}/{swarm}/station/inform/**"


def copies(swarm: str) -> str:
    """Return the key expression that matches the ground stations' copies of the UAVs' messages."""
    return f"{ROOT}/{swarm}/station/propagate/**"


def request(swarm: str, kind: RequestKind, uav: int) -> str:
    """Return the key of an operator's requests to the agent of a vehicle."""
    return f"{ROOT}/{swarm}/uav/{uav}/request/{kind}/operator"


def swarm_vehicles(swarm: str) -> str:
    """Return the key of an operator's question to `swarmctl fly` which vehicles the swarm has."""
    return f"{ROOT}/{swarm}/station/query-ref/vehicles/operator"


def sensor_report(swarm: str, uav: int) -> str:
    """Return the key of a payload's reports to its vehicle's agent."""
    return f"{ROOT}/{swarm}/uav/{uav}/inform/look/sensor"


def sender_of(key: str) -> tuple[int, str] | None:
    """Return (sender, act) of the key of a UAV's message; None for all other keys and for wildcards.

    A put on a wildcard key would reach every inbox and pass a router's deny rules. The result is not cached,
    because other processes choose the key.
    """
    if len(key) > MAX_LENGTH or is_wild(key):
        return None
    parts = key.split("/")
    sender = parts[-1]
    if len(parts) < 3 or len(sender) > MAX_DIGITS or not (sender.isascii() and sender.isdigit()):
        return None
    return int(sender), "/".join(parts[-3:-1])


def is_wild(key: str) -> bool:
    return "*" in key or "$" in key
