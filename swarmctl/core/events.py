"""The closed lists of what can happen to an agent (events) and what it can ask for (effects).

Both are plain data, so that a run is recorded as it happened and folded again by `swarmctl replay`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

import msgspec

from swarmctl.core.any_angle.pull import Track
from swarmctl.core.frames import AgentMessage, IntentShared, StateShared
from swarmctl.core.grid import Cell
from swarmctl.core.messages import VehicleAnswer
from swarmctl.core.mission import FlightPlan
from swarmctl.core.observation import BeliefItem
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import VehicleState

ObservationId = tuple[int, int, int]
"""(observer, incarnation, seq); a checkpoint goes by the last observation it stands for"""


class FlightOrder(StrEnum):
    """What a vehicle can be told to do besides flying a mission."""

    LAUNCH = "launch"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


PlanLeft = Literal["old", "hold", "theirs", "unknown"]
"""Which plan a vehicle is left with after a swap that failed."""


class _Record(msgspec.Struct, frozen=True, tag=True):
    pass


# --- events


class Joined(_Record, frozen=True):
    """It is on the swarm's network."""

    incarnation: int
    """greater each time its program is started; names its observations"""


class Ready(_Record, frozen=True):
    """The vehicle answers, is the one it should be, and would arm now."""


class TelemetryReceived(_Record, frozen=True):
    state: VehicleState


class Observed(_Record, frozen=True):
    """The vehicle's own sensor looked: (row, col, occupied) of each cell in its footprint."""

    cells: tuple[tuple[int, int, bool], ...]


class ObservationsReceived(_Record, frozen=True, tag="Heard"):
    """What others saw and was not known here."""

    told: tuple[BeliefItem, ...]


class Neighbours(_Record, frozen=True):
    """What others near it have told of themselves since the last time: (UAV, its state)."""

    states: tuple[tuple[int, StateShared], ...]


class Intents(_Record, frozen=True):
    """What others have told of where they will be: (UAV, how long ago that was said [s], its intent)."""

    told: tuple[tuple[int, float, IntentShared], ...]


class MissionAccepted(_Record, frozen=True):
    """The vehicle holds plan `plan_id`, read back and compared; in flight it flies it."""

    plan_id: int
    took_s: float | None = None
    """in flight: from when it was begun to change its mission until it flew this one, by its clock; on the
    ground: how long that will take, by how long the upload took"""
    stood_still_s: float = 0.0
    """for how long it held or stood still for that"""


class MissionFailed(_Record, frozen=True):
    plan_id: int
    flying: PlanLeft
    reason: str
    stood_still_s: float = 0.0
    is_late: bool = False
    """the vehicle was past where the plan leaves the old one when it could have been taken over"""


class OrderDone(_Record, frozen=True):
    order: FlightOrder


class OrderFailed(_Record, frozen=True):
    order: FlightOrder
    reason: str
    nothing_sent: bool = False
    """what has to be looked at before a launch forbade it"""


class LaunchPostponed(_Record, frozen=True, tag="LaunchPutOff"):
    """Before it took off somebody came into its way; it is not armed."""

    reason: str
    was_armed: bool = False
    """and has been disarmed again"""


class SpeedFailed(_Record, frozen=True):
    reason: str


class LinkLost(_Record, frozen=True):
    age_s: float


class LinkRestored(_Record, frozen=True):
    pass


class OperatorCommand(_Record, frozen=True):
    order: FlightOrder
    command: int | None = None
    """the operator desk's running number, which the `Answer` repeats; None: its own process orders this"""
    after_s: float = 0.0
    """of a return: it holds for so long first, by the vehicle's clock, because others return before it"""
    ignore: tuple[int, ...] = msgspec.field(default=(), name="past")
    """of a launch: it waits for none of these"""


class WeightsChanged(_Record, frozen=True):
    """An operator wants other weights from the next plan on; None leaves one as it is."""

    command: int
    """the operator desk's running number, which the `Answer` repeats"""
    w: float | None = None
    strength: FiringStrength | None = None


class Rebooted(_Record, frozen=True):
    """Its clock went back: what was set on it may be gone."""


class Tick(_Record, frozen=True):
    """Everything that had arrived has been handed over: decide now."""


Event = (
    Joined
    | Ready
    | TelemetryReceived
    | Observed
    | ObservationsReceived
    | Neighbours
    | Intents
    | MissionAccepted
    | MissionFailed
    | OrderDone
    | OrderFailed
    | LaunchPostponed
    | SpeedFailed
    | LinkLost
    | LinkRestored
    | OperatorCommand
    | WeightsChanged
    | Rebooted
    | Tick
)

# --- effects


class Publish(_Record, frozen=True):
    message: AgentMessage
    against: tuple[Cell, ...] = ()
    """the cells it saw otherwise than others had told"""


class SwapMission(_Record, frozen=True):
    """Give the vehicle this plan; on the ground an upload, in flight a transaction."""

    plan_id: int
    plan: FlightPlan
    cells: tuple[Cell, ...]
    """the lattice route behind the plan"""
    because: tuple[ObservationId, ...]
    """the observations merged since the last decision"""
    cost: float
    exposure_sum: float
    safety_factor: float
    length_m: float
    track: Track | None = None
    """what is flown instead of the lattice route, where routes are pulled straight; exposure_sum,
    safety_factor and length_m are then the track's, `cost` the route's"""


class Command(_Record, frozen=True):
    order: FlightOrder
    by_person: bool = False
    """just now: it goes out unseen"""


class SetSpeed(_Record, frozen=True):
    """Fly the mission so fast over ground."""

    speed_m_s: float


class Release(_Record, frozen=True):
    """Stop whatever is being done to the vehicle: somebody else has it."""


class Answer(_Record, frozen=True):
    """What became of an operator's command, for whoever gave it."""

    command: int
    answer: VehicleAnswer


class NotifyOperator(_Record, frozen=True, tag="Tell"):
    """The operator has to know this of the vehicle."""

    text: str


Effect = Publish | SwapMission | Command | SetSpeed | Release | Answer | NotifyOperator
