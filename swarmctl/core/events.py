"""The closed lists of an agent's inputs (events) and outputs (effects).

Both are plain data, so that `swarmctl replay` can fold the events of a recorded run again.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

import msgspec

from swarmctl.core.frames import AgentMessage, IntentShared, MemberShared, StateShared
from swarmctl.core.grid import Cell
from swarmctl.core.messages import CommunicationRange, VehicleAnswer
from swarmctl.core.observation import BeliefItem
from swarmctl.core.planned_mission import PlannedMission
from swarmctl.core.setpoint import SetPoint
from swarmctl.core.threat import FiringStrength
from swarmctl.core.vehicle import VehicleState


class FlightOrder(StrEnum):
    """Orders to a vehicle besides its mission."""

    LAUNCH = "launch"
    RESUME = "resume"
    """end of a hold, with a new plan from the vehicle's position; never a command to the vehicle"""
    FORMATION = "formation"
    """flight by set-points, in a group"""
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"


PlanAfterFailure = Literal["old", "hold", "theirs", "unknown"]
"""The vehicle's state after a failed swap: its old plan, a hold, another station's plan, or unknown."""


class _Record(msgspec.Struct, frozen=True, tag=True):
    pass


# --- events


class Joined(_Record, frozen=True):
    """The agent has joined the swarm's network."""

    incarnation: int
    """number that grows with each start of the agent's program; part of the names of observations"""


class Restarted(_Record, frozen=True):
    """The agent's program has been started anew, and has compared the vehicle with the earlier record."""

    on_ground: bool = False
    """True: the vehicle is disarmed on the ground"""
    lands: bool = False
    """True: the vehicle flies the landing of its plan"""
    reason: str = ""
    """reason why the program cannot take the vehicle over; empty if it can"""


class Ready(_Record, frozen=True):
    """The vehicle answers, has the expected identity, and is ready to arm."""

    firmware: str = ""
    """name and version; empty without an identity"""
    uid2: str = ""
    """the autopilot's unique id, as hex digits"""


class TelemetryReceived(_Record, frozen=True, omit_defaults=True):
    """A new state of the vehicle, with what other UAVs have told since the last one.

    A message comes as (UAV, age of the message [s], message).
    """

    state: VehicleState
    members: tuple[tuple[int, float, MemberShared], ...] = ()
    """new messages of the members of this vehicle's group"""
    neighbours: tuple[tuple[int, StateShared], ...] = ()
    """new states of other UAVs that matter to this agent: (UAV, its state)"""
    intents: tuple[tuple[int, float, IntentShared], ...] = ()
    """new intents of all other UAVs"""


class Observed(_Record, frozen=True):
    """An observation by the vehicle's sensor, a payload or an operator: (row, col, occupied) of each cell."""

    cells: tuple[tuple[int, int, bool], ...]


class ObservationsReceived(_Record, frozen=True):
    """Observations of other UAVs that are new to this agent."""

    items: tuple[BeliefItem, ...]


class MissionAccepted(_Record, frozen=True):
    """Plan `plan_id` is on the vehicle, read back and compared. A vehicle in flight flies this plan."""

    plan_id: int
    took_s: float | None = None
    """duration of the swap [s]: in flight measured, on the ground estimated from the upload's duration"""
    stood_still_s: float = 0.0
    """time for which the vehicle held or stood still for the swap [s]"""


class MissionFailed(_Record, frozen=True):
    """The upload or the swap of plan `plan_id` has failed."""

    plan_id: int
    flying: PlanAfterFailure
    reason: str
    stood_still_s: float = 0.0
    is_late: bool = False
    """the plan was ready only after the vehicle had passed the splice point"""


class OrderDone(_Record, frozen=True):
    order: FlightOrder


class OrderFailed(_Record, frozen=True):
    order: FlightOrder
    reason: str
    nothing_sent: bool = False
    """a check before the launch failed, and no command was sent"""


class LaunchPostponed(_Record, frozen=True):
    """A check before the take-off found a conflict with another vehicle; this vehicle is not armed."""

    reason: str
    was_armed: bool = False
    """the vehicle was armed and has been disarmed again"""


class SpeedFailed(_Record, frozen=True):
    reason: str


class LinkLost(_Record, frozen=True):
    """The link is lost; the event comes again each second."""

    age_s: float
    """time since the last heartbeat [s]"""


class LinkRestored(_Record, frozen=True):
    pass


class OperatorCommand(_Record, frozen=True):
    order: FlightOrder
    request_id: int | None = None
    """number from the operator service, repeated in the `Answer`; None: an order of the agent's process"""
    after_s: float | None = None
    """time of a hold before a return in a recall, by the vehicle's clock [s]; None: a vehicle holds until its
    return path, or the ground below it, is clear of other vehicles"""
    ignore: tuple[int, ...] = ()
    """vehicles that a launch does not wait for"""
    by: str = ""
    """person and program that gave the order; empty: not told"""


class WeightsChanged(_Record, frozen=True):
    """An operator's new weights and new range of communication; None: no change."""

    request_id: int
    """number from the operator service, repeated in the `Answer`"""
    w: float | None = None
    strength: FiringStrength | None = None
    range: CommunicationRange | None = None
    by: str = ""
    """person and program that gave the command; empty: not told"""
    behaviours: dict[str, float] = {}
    """new weights of behaviours in the group's flight, by name"""


class Rebooted(_Record, frozen=True):
    """The vehicle's clock went back, so its settings may be lost."""


class Tick(_Record, frozen=True):
    """All events received so far are folded; the agent decides now."""


Event = (
    Joined
    | Restarted
    | Ready
    | TelemetryReceived
    | Observed
    | ObservationsReceived
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
    """Send a message to the swarm."""

    message: AgentMessage
    against: tuple[Cell, ...] = ()
    """observed cells that contradict observations of other UAVs"""
    group: tuple[int, ...] = ()
    """receivers of a MemberShared"""


class SwapMission(_Record, frozen=True):
    """Put this mission on the vehicle: by an upload on the ground, by a verified swap in flight."""

    mission: PlannedMission


class Command(_Record, frozen=True):
    """Send an order to the vehicle."""

    order: FlightOrder
    by_person: bool = False
    """True if an operator or a recall has just given the order (`check_mode_first` is False)"""


class SetSpeed(_Record, frozen=True):
    """Set the mission speed over ground; for a fixed wing the airspeed."""

    speed_m_s: float


class SetRange(_Record, frozen=True):
    """Send to this number of nearest vehicles from now on."""

    range: CommunicationRange


class SendSetPoint(_Record, frozen=True):
    """Send this set-point to the vehicle now; nothing repeats it."""

    set_point: SetPoint


class Release(_Record, frozen=True):
    """End the agent's own commands to the vehicle: a pilot, a failsafe or another station has taken over."""


class Answer(_Record, frozen=True):
    """The answer to an operator's command."""

    request_id: int
    answer: VehicleAnswer


class NotifyOperator(_Record, frozen=True):
    """A text about the vehicle for the operator."""

    text: str


class LaunchConflict(_Record, frozen=True):
    """The conflict of the first route has changed, or is over; the launch ends at a conflict."""

    text: str
    """empty: no conflict"""


Effect = (
    Publish
    | SwapMission
    | Command
    | SendSetPoint
    | LaunchConflict
    | SetSpeed
    | SetRange
    | Release
    | Answer
    | NotifyOperator
)
