"""Every key of the bus, in one table.

| key | from | to | payload |
|---|---|---|---|
| `swarmctl/SWARM/uav/TO/inform/observation/FROM` | a UAV | a UAV in its reach | ObservationShared |
| `swarmctl/SWARM/uav/TO/inform/state/FROM` | a UAV | a UAV in its reach | StateShared |
| `swarmctl/SWARM/operator/weights` | an operator, who asks | the ground station | SetWeights; WeightsAnswer |

Every UAV reads its own inbox only; SWARM is the configuration's name, TO and FROM are system ids.
"""

from __future__ import annotations

from swarmctl.core.messages import Message, ObservationShared

ROOT = "swarmctl"
SWARM_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
"""what a swarm may be called: one part of a key, no wildcard; of a file's name, not a hidden one"""


def inform(swarm: str, to: int, message: Message) -> str:
    """The key under which `message` goes into the inbox of UAV `to`."""
    kind = "observation" if isinstance(message, ObservationShared) else "state"
    return f"{ROOT}/{swarm}/uav/{to}/inform/{kind}/{message.sender}"


def inbox(swarm: str, uav: int) -> str:
    """The key expression that matches everything sent to `uav`."""
    return f"{ROOT}/{swarm}/uav/{uav}/**"


def weights(swarm: str) -> str:
    """Where an operator changes the weights of a swarm."""
    return f"{ROOT}/{swarm}/operator/weights"


def sender_of(key: str) -> int | None:
    """The UAV a key says it comes from; None where it names none.

    A put on a wildcard key reaches every inbox and passes a router's deny rules: such a key is nobody's.
    """
    if "*" in key or "$" in key:
        return None
    last = key.rsplit("/", 1)[-1]
    return int(last) if last.isascii() and last.isdigit() else None
