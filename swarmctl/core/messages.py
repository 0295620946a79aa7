"""Operator commands to agents and their answers, and the bytes of both on the bus.

A message is one version byte and a MessagePack map (msgspec). A message is refused if it has another version
or an invalid value, or lacks a field without a default. Unknown fields of an answer are ignored. A command
with an unknown field is refused, because an agent must not execute only a part of a command.
"""

from __future__ import annotations

from typing import Literal, TypeVar

import msgspec

from swarmctl.core.threat import FiringStrength

VERSION = 3
MAX_SYSTEM_ID = 254
"""greatest system id of a vehicle; 255 is a ground station's by convention"""
ENDING_ORDERS = ("hold", "return", "land")
"""orders that end a flight"""
MAX_AFTER_S = 7200.0
"""longest wait of a vehicle for its turn to return [s]"""
MAX_NAME = 32
"""longest name of a vehicle [characters]"""
MAX_BEHAVIOUR_WEIGHT = 100.0
"""greatest weight of a behaviour in a group's flight"""
MAX_BEHAVIOURS = 8
"""greatest number of behaviours of an approach to formation flight"""
MAX_BY = 64
"""longest name of a person [characters]"""


# --- between an operator and the swarm


CommunicationRange = int | Literal["all"]


class SetWeights(
    msgspec.Struct, frozen=True, omit_defaults=True, tag="set_weights", forbid_unknown_fields=True
):
    """An operator's command: new weights from the next plan on, a new range of communication, and new weights
    of a group's behaviours.

    Raises ValueError for invalid values.
    """

    uavs: tuple[int | str, ...] | None
    """system ids or names; None: all of the swarm"""
    w: float | None = None
    """weight in [0, 1]: 0 for the shortest route, 1 for the least exposed route; None: no change"""
    firing_strength: tuple[float, float, float] | None = None
    """direct, first and second neighbour (Eq. 1); None: no change"""
    range: CommunicationRange | None = None
    """number of nearest vehicles that get each message, in a simulated swarm; None: no change"""
    by: str = ""
    """person and program that give the command, for the evidence; empty: not told"""
    behaviours: dict[str, float] = {}
    """new weights of behaviours in a group's flight, by name; the leader's count for all its members"""

    def __post_init__(self) -> None:
        if self.uavs is not None:
            _check_named(self.uavs)
        _check_by(self.by)
        if self.w is None and self.firing_strength is None and self.range is None and not self.behaviours:
            raise ValueError(
                "nothing to change: expected w, firing strengths, the range of communication, or weights of "
                "behaviours [nothing-to-change]"
            )
        for name, weight in self.behaviours.items():
            if not 0.0 <= weight <= MAX_BEHAVIOUR_WEIGHT or len(name) > MAX_NAME:
                raise ValueError(
                    f"behaviour {name[:MAX_NAME]} = {weight:g}: expected a weight of 0 to "
                    f"{MAX_BEHAVIOUR_WEIGHT:g}"
                )
        if len(self.behaviours) > MAX_BEHAVIOURS:
            raise ValueError(f"{len(self.behaviours)} behaviours: expected at most {MAX_BEHAVIOURS}")
        if isinstance(self.range, int) and not 0 <= self.range <= MAX_SYSTEM_ID:
            raise ValueError(f"range = {self.range}: expected 0 to {MAX_SYSTEM_ID}, or all")
        if self.w is not None and not 0.0 <= self.w <= 1.0:
            raise ValueError(f"w = {self.w:g}: expected 0 (the shortest route) to 1 (the least exposed)")
        _ = self.strength

    @property
    def strength(self) -> FiringStrength | None:
        return None if self.firing_strength is None else FiringStrength(*self.firing_strength)


OrderKind = Literal["launch", "resume", "hold", "return", "land"]
"""an operator's order"""


class GiveOrder(
    msgspec.Struct, frozen=True, omit_defaults=True, tag="give_order", forbid_unknown_fields=True
):
    """An operator's command to launch, resume, hold, return or land now.

    Raises ValueError for invalid values.
    """

    uavs: tuple[int | str, ...] | None
    """system ids or names; None: all of the swarm"""
    order: OrderKind
    after_s: float | None = None
    """time for which the vehicle holds before a return in a recall [s]; None: no recall"""
    ignore: tuple[int | str, ...] = ()
    """vehicles that a launch does not wait for"""
    by: str = ""
    """person and program that give the command, for the evidence; empty: not told"""

    def __post_init__(self) -> None:
        if self.uavs is not None:
            _check_named(self.uavs)
        _check_by(self.by)
        if self.after_s is not None and not 0.0 <= self.after_s <= MAX_AFTER_S:
            raise ValueError(f"after_s = {self.after_s:g}: expected 0 to {MAX_AFTER_S:g}")
        if self.after_s and self.order != "return":
            raise ValueError(f"after_s = {self.after_s:g} with order {self.order}: only return has after_s")
        if self.ignore:
            _check_named(self.ignore)
            if self.order != "launch":
                raise ValueError(f"ignore with order {self.order}: only launch has ignore")


Request = SetWeights | GiveOrder
"""a command of an operator to agents"""


def _check_by(by: str) -> None:
    if len(by) > MAX_BY:
        raise ValueError(f"a person's name of {len(by)} characters: expected at most {MAX_BY}")


def _check_named(uavs: tuple[int | str, ...]) -> None:
    if not uavs:
        raise ValueError("no vehicle named: expected system ids or names, or all [which-vehicles]")
    if len(uavs) > MAX_SYSTEM_ID:
        raise ValueError(f"{len(uavs)} vehicles named: expected at most {MAX_SYSTEM_ID}, or all")
    for uav in uavs:
        if isinstance(uav, int) and not 1 <= uav <= MAX_SYSTEM_ID:
            raise ValueError(f"system id {uav}: expected 1 to {MAX_SYSTEM_ID}")
        if isinstance(uav, str) and not 1 <= len(uav) <= MAX_NAME:
            raise ValueError(f"a vehicle's name of {len(uav)} characters: expected 1 to {MAX_NAME}")


CommandOutcome = Literal["taken", "refused", "over", "unconfirmed", "silent"]


class VehiclePosition(msgspec.Struct, frozen=True):
    """The position of a vehicle in flight, from which a recall of several vehicles is scheduled."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    home_lat_deg: float
    home_lon_deg: float
    home_alt_amsl_m: float
    speed_m_s: float
    min_separation_m: tuple[float, float]
    """required distances to other vehicles, over ground and in height [m]"""
    is_returning: bool = False


class VehicleAnswer(msgspec.Struct, frozen=True, tag="vehicle_answer"):
    """The answer of one vehicle to a command."""

    uav: int
    """system id; 0 in the refusal of a name that no vehicle has"""
    name: str
    outcome: CommandOutcome
    """- taken: the agent follows the command
    - refused: the command had no effect
    - over: the vehicle no longer plans, or its flight has ended
    - unconfirmed: no valid answer in time; the agent may follow the command
    - silent: no agent answers
    """
    from_plan: int | None = None
    """number of the first plan with the new weights"""
    note: str = ""
    """reason of a refusal, or a remark"""
    place: VehiclePosition | None = None
    """None on the ground, and if the position is unknown"""


class SwarmVehicles(msgspec.Struct, frozen=True, tag="swarm_vehicles"):
    """The vehicles of a swarm that one process flies."""

    names: dict[int, str]
    """by system id, in the order of the swarm"""


class Refusal(msgspec.Struct, frozen=True, tag="refusal"):
    """The answer to a request that had no effect."""

    why: str


Answer = VehicleAnswer | SwarmVehicles | Refusal
"""an answer to an operator's request"""


class BadMessage(ValueError):
    """Bytes from the bus that are not a valid message; the text says what is invalid."""


T = TypeVar("T")
AnswerT = TypeVar("AnswerT", VehicleAnswer, SwarmVehicles)
_encoder = msgspec.msgpack.Encoder()
_commands: msgspec.msgpack.Decoder[Request] = msgspec.msgpack.Decoder(Request)
_answers: msgspec.msgpack.Decoder[Answer] = msgspec.msgpack.Decoder(Answer)


def encode(message: Request | Answer) -> bytes:
    return bytes((VERSION,)) + _encoder.encode(message)


def decode_command(data: bytes) -> Request:
    """Decode an operator's command. Raises BadMessage for invalid bytes, and no other exception."""
    return _decode(data, _commands)


def decode_answer(data: bytes, kind: type[AnswerT]) -> AnswerT | Refusal:
    """Decode an answer of this kind, or a refusal. Raises BadMessage, and no other exception."""
    answer = _decode(data, _answers)
    if isinstance(answer, kind | Refusal):
        return answer
    raise BadMessage(f"found {type(answer).__name__}, expected {kind.__name__} [invalid-message]")


def _decode(data: bytes, decoder: msgspec.msgpack.Decoder[T]) -> T:
    if not data:
        raise BadMessage("the payload is empty, expected a version byte and MessagePack [invalid-message]")
    if data[0] != VERSION:
        raise BadMessage(f"the message has version {data[0]}, expected {VERSION} [other-version]")
    try:
        return decoder.decode(memoryview(data)[1:])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadMessage(f"not a valid message of version {VERSION}: {error} [invalid-message]") from error
