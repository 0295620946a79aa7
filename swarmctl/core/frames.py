"""Messages between UAVs, typed as the acts of FIPA's agent communication language, and their bytes.

| act/kind | content | meaning |
|---|---|---|
| `inform/observation` | Observation | cells that the sender has just observed |
| `inform/state` | StateShared | position, phase, counts of observations; once a second |
| `inform/intent` | IntentShared | future positions with times; after each change, and every few seconds |
| `inform/member` | MemberShared | place in a formation; some times a second, to the members of the group |
| `query-ref/snapshot` | SnapshotAsked | request for missing observations; lists the sender's observations |
| `inform/snapshot` | Snapshot | the answer: frames as received, with observations, states and intents |
| `inform/relayed` | Relayed | new frames of other UAVs, passed on at once; or a checkpoint of the sender |
| `inform/checkpoint` | Checkpoint | inside both messages above: replaces an observer's first observations |

A frame is the byte VERSION, a flag byte (signed or not), a 64-byte Ed25519 signature if signed, and a
MessagePack map. The signature covers the swarm's name and the map. Unknown fields are ignored. A frame is
refused if it has another version or an invalid value, or lacks a field without a default.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Hashable
from enum import StrEnum
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any

import msgspec

from swarmctl.core.geo import LatLon
from swarmctl.core.messages import MAX_BEHAVIOUR_WEIGHT, MAX_BEHAVIOURS
from swarmctl.core.observation import Checkpoint, Id, Incarnation, Observation, Seq
from swarmctl.core.records import replace
from swarmctl.core.split import SplitShared

VERSION = 3
UNSIGNED, SIGNED = 0, 1
SIGNATURE_BYTES = 64
MAX_FRAME_BYTES = 49_152
"""longest frame [bytes]; a longer received frame is refused"""
MAX_INNER_BYTES = MAX_FRAME_BYTES - 8192
"""greatest total length of the frames inside one message [bytes]; a longer answer is split"""
MAX_TEXT = 200
"""longest text [characters]"""
MAX_POINTS = 256
"""most points of an intent; only the first points of a longer flight are sent"""
MAX_AHEAD_S = 14_400.0
"""latest time of a point in an intent, after the time of sending [s]"""
MAX_MAGNITUDE = 1e7
"""Greatest height, distance [m] or speed [m/s] in a message. Autopilots report numbers up to 2.2e6. Sums of
such numbers stay finite."""
MAX_ACKNOWLEDGED = 254
"""most UAVs in `StateShared.hears`: the number of system ids"""
MAX_FRAMES = 256
"""most frames inside one message"""

# The decoder refuses numbers outside of these limits, and NaN.
Finite = Annotated[float, msgspec.Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
Latitude = Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)]
Longitude = Annotated[float, msgspec.Meta(ge=-180.0, le=180.0)]
Magnitude = Annotated[float, msgspec.Meta(ge=-MAX_MAGNITUDE, le=MAX_MAGNITUDE)]
NonNegative = Annotated[float, msgspec.Meta(ge=0.0, le=MAX_MAGNITUDE)]
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=MAX_AHEAD_S)]
Velocity = tuple[Magnitude, Magnitude, Magnitude]
"""east, north, up [m/s]"""
Frames = Annotated[tuple[bytes, ...], msgspec.Meta(max_length=MAX_FRAMES)]
Text = Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]


class RefusalReason(StrEnum):
    """Reasons to refuse a message."""

    MALFORMED = "malformed"
    OVERSIZE = "oversize"
    VERSION = "other version"
    UNSIGNED = "not signed"
    SIGNATURE = "wrong signature"
    WILDCARD = "wildcard key"
    SOURCE = "wrong source"
    """the key, the frame and the content name different senders"""
    STRANGER = "not of this swarm"
    REPLAY = "replay"
    FUTURE = "from the future"
    OUTSIDE = "outside the area"
    TWO_CONTENTS = "two contents"
    TOO_FAST = "too fast"


class MessageRefused(ValueError):
    """A refused message: `why` is the reason, the text says what is invalid."""

    def __init__(self, why: RefusalReason, text: str) -> None:
        super().__init__(f"{why}: {text}")
        self.why = why


class StateShared(msgspec.Struct, frozen=True, omit_defaults=True, gc=False, tag="inform/state"):
    """Position, phase and knowledge of a UAV."""

    time_s: Finite
    """vehicle's clock since boot [s]"""
    lat_deg: Latitude
    lon_deg: Longitude
    alt_rel_m: Magnitude
    alt_amsl_m: Magnitude
    phase: Text
    n_observed: int
    n_found: int
    last_seq: int = 0
    """sequence number of the UAV's last own observation"""
    knows: int = 0
    """exclusive or of `mark_of` over all observations that the UAV holds"""
    mode: Text = ""
    plan_id: int = 0
    replans: int = 0
    late_s: Finite | None = None
    """predicted time from take-off to arrival [s], if outside the time bound; else None"""
    outcome: Text = ""
    trouble: Text = ""
    refused: int = 0
    """number of messages that the UAV refused"""
    flagged: tuple[int, ...] = ()
    """UAVs whose observations contradict this UAV's observations, or each other"""
    velocity_m_s: Velocity = (0.0, 0.0, 0.0)
    earliest_in_s: Finite | None = None
    """least time to the goal [s], negative after the arrival; None if no simultaneous arrival is planned"""
    hears: Annotated[tuple[Id, ...], msgspec.Meta(max_length=MAX_ACKNOWLEDGED)] = ()
    """nearby UAVs whose messages arrived recently; an acknowledgement to each of them"""
    returns_to: tuple[Latitude, Longitude] | None = None
    """home of a UAV that returns, or that holds until its turn to return [deg]"""
    age_s: Annotated[float, msgspec.Meta(ge=0.0, le=sys.float_info.max)] = 0.0
    """age of position, height and velocity [s]; 0 while new values arrive from the vehicle"""
    battery_percent: Annotated[int, msgspec.Meta(ge=0, le=100)] | None = None
    strikes: Annotated[int, msgspec.Meta(ge=0, lt=2**31)] = 0
    to_go_m: Finite | None = None
    """distance along the route to its last waypoint [m], negative past it; None without a route"""
    waits: Text = ""
    """what the UAV waits for, in words; empty: for nothing"""
    group: Text = ""
    """group, shape, leader and place error of a UAV in a formation, in words; empty: none"""
    weights: tuple[Finite, Finite, Finite, Finite] | None = None
    """w and the three firing strengths after a change by an operator; None: those of the configuration"""
    hovers: bool = True
    """False: the UAV is a fixed wing, which cannot stop"""


class IntentPoint(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """A future position of a UAV."""

    in_s: Seconds
    """time after the UAV's last telemetry, which is `IntentShared.age_s` before the frame was sent [s]"""
    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Magnitude


class IntentShared(msgspec.Struct, frozen=True, omit_defaults=True, dict=True, tag="inform/intent"):
    """The present or next flight of a UAV: straight from point to point."""

    plan_id: int
    """number of the plan that the UAV flies or uploads; 0: no plan"""
    points: Annotated[tuple[IntentPoint, ...], msgspec.Meta(max_length=MAX_POINTS)] = ()
    """points with increasing times; empty: the flight is unknown"""
    may_change: bool = True
    """True if the UAV can give way: its agent may change its mission, now or after take-off"""
    around_m: tuple[NonNegative, NonNegative] = (0.0, 0.0)
    """greatest distance of the UAV from the announced flight, over ground and in height [m]"""
    on_ground: bool = False
    """True from the launch order until the UAV has taken off"""
    age_s: Seconds = 0.0
    """age of the UAV's last telemetry when the message was sent [s]"""

    @cached_property
    def derived(self) -> dict[Hashable, Any]:
        """Values computed from the message alone, once for all receivers in this process."""
        return {}

    def __post_init__(self) -> None:
        if any(later.in_s <= point.in_s for point, later in pairwise(self.points)):
            raise ValueError("times do not increase: expected each to be later than the previous one")


class MemberShared(msgspec.Struct, frozen=True, omit_defaults=True, gc=False, tag="inform/member"):
    """Position and velocity of a member of a formation, and what the leader decides for the group."""

    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Magnitude
    velocity_m_s: Velocity
    age_s: Seconds = 0.0
    """age of position and velocity when the message was sent [s]"""
    joins: bool = True
    """False: the member leaves the group, or its flight ends"""
    error_m: NonNegative = 0.0
    """distance of the member from its place [m]"""
    along_m: NonNegative = 0.0
    """the leader's alone: distance of the group's reference along the route [m]"""
    speed_m_s: NonNegative = 0.0
    """the leader's alone: speed of the reference along the route [m/s]"""
    route_id: int = 0
    """the leader's alone: number of the group's route; 0: the sender does not lead"""
    route: Annotated[tuple[tuple[Latitude, Longitude], ...], msgspec.Meta(max_length=MAX_POINTS)] = ()
    """the leader's alone: the route's points [deg]; empty in most messages, for they seldom change"""
    shapes: Annotated[
        tuple[tuple[Magnitude, Annotated[int, msgspec.Meta(ge=0, le=1)]], ...],
        msgspec.Meta(max_length=MAX_POINTS),
    ] = ()
    """changes of shape along `route`: (distance [m], number of the shape from there on)"""
    split: SplitShared | None = None
    """a split of the group along `route`"""
    height_amsl_m: Magnitude = 0.0
    """the leader's alone: the group's height above the sea, if its members fly level [m]"""
    weights: Annotated[
        tuple[Annotated[float, msgspec.Meta(ge=0.0, le=MAX_BEHAVIOUR_WEIGHT)], ...],
        msgspec.Meta(max_length=MAX_BEHAVIOURS),
    ] = ()
    """the leader's alone: the weights of all behaviours of the approach, after an operator's change"""

    def with_route_of(self, before: MemberShared) -> MemberShared:
        """Return the message; if it lacks the route that `before` has, with this route."""
        if self.route or before.route_id != self.route_id:
            return self
        return replace(self, route=before.route, shapes=before.shapes, split=before.split)


class HeldObservations(msgspec.Struct, frozen=True, array_like=True):
    """The observations of one source that a UAV holds."""

    observer: Id
    incarnation: Incarnation
    checkpoint: int
    """number of the last observation in the held checkpoint; 0: no checkpoint"""
    upto: int
    """number up to which all observations are held"""
    beyond: tuple[Seq, ...] = ()
    """numbers of observations held after `upto`; of many, only the lowest"""
    mark: int = 0
    """combined mark of all held observations (`swarmctl.core.observation.mark_of`)"""


class SnapshotAsked(msgspec.Struct, frozen=True, tag="query-ref/snapshot"):
    """A request for missing observations. `have` names the observations that the sender holds."""

    have: tuple[HeldObservations, ...]
    states: tuple[tuple[Id, float], ...]
    """(UAV, time of the UAV's last state that the sender holds (unix) [s])"""


class Snapshot(msgspec.Struct, frozen=True, tag="inform/snapshot"):
    """Part of the answer to a `SnapshotAsked`."""

    frames: Frames
    last: bool


class Relayed(msgspec.Struct, frozen=True, tag="inform/relayed"):
    """Frames of other UAVs that are new to the sender, or the sender's own checkpoint."""

    frames: Frames


Content = (
    Observation | Checkpoint | StateShared | IntentShared | MemberShared | SnapshotAsked | Snapshot | Relayed
)
AgentMessage = Observation | StateShared | IntentShared | MemberShared
"""contents from the agent; the node itself makes the other contents"""


class Frame(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """A message with its sender; all receivers get the same bytes."""

    sender: Id
    incarnation: Incarnation
    n: Seq
    """running number of the messages of this sender's incarnation"""
    unix_s: Finite
    """time of sending (unix) [s]"""
    content: Content
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    """position of the sender [deg]; None if unknown, or if the content has the position"""

    @property
    def at(self) -> LatLon | None:
        content = self.content
        if isinstance(content, StateShared | MemberShared):
            return content.lat_deg, content.lon_deg
        return None if self.lat_deg is None or self.lon_deg is None else (self.lat_deg, self.lon_deg)

    @property
    def act(self) -> str:
        """Act and kind, as in the message's key."""
        return act_of(self.content)


def act_of(content: Content) -> str:
    return str(type(content).__struct_config__.tag)


Sign = Callable[[int, bytes], bytes | None]
"""(sender, signed bytes) -> signature; None without a key"""
Verify = Callable[[int, bytes, bytes], bool]
"""(sender, signature, signed bytes) -> True for a valid signature of the sender"""

_encoder = msgspec.msgpack.Encoder()
_frames: msgspec.msgpack.Decoder[Frame] = msgspec.msgpack.Decoder(Frame)


class FrameCodec:
    """A codec of frames. `sign` None: frames are unsigned. `verify` None: signatures are ignored."""

    def __init__(self, swarm: str, sign: Sign | None = None, verify: Verify | None = None) -> None:
        self._domain = b"swarmctl\0" + swarm.encode() + b"\0"
        self._sign = sign
        self._verify = verify

    def encode(self, frame: Frame) -> bytes:
        """Return the bytes of a frame of this process."""
        body = _encoder.encode(frame)
        signature = None if self._sign is None else self._sign(frame.sender, self._domain + body)
        if signature is None:
            return bytes((VERSION, UNSIGNED)) + body
        return bytes((VERSION, SIGNED)) + signature + body

    def decode(self, data: bytes) -> Frame:
        """Return the frame in `data`. Raises MessageRefused for invalid bytes, and no other exception."""
        if len(data) > MAX_FRAME_BYTES:
            raise MessageRefused(
                RefusalReason.OVERSIZE, f"{len(data)} bytes, expected at most {MAX_FRAME_BYTES}"
            )
        if len(data) < 2:
            raise MessageRefused(RefusalReason.MALFORMED, "expected a version, a flag and MessagePack")
        if data[0] != VERSION:
            raise MessageRefused(
                RefusalReason.VERSION, f"version {data[0]}, this program speaks version {VERSION}"
            )
        start = 2 + SIGNATURE_BYTES if data[1] == SIGNED else 2
        body = data[start:]
        try:
            frame = _frames.decode(body)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise MessageRefused(
                RefusalReason.MALFORMED, f"not a message of version {VERSION}: {error}"
            ) from None
        if self._verify is not None:
            if data[1] != SIGNED:
                raise MessageRefused(
                    RefusalReason.UNSIGNED, f"a message of vehicle {frame.sender} without a signature"
                )
            if not self._verify(frame.sender, data[2:start], self._domain + body):
                raise MessageRefused(
                    RefusalReason.SIGNATURE, f"a message that vehicle {frame.sender} did not sign"
                )
        content = frame.content
        if isinstance(content, Observation | Checkpoint):
            self._check_source(frame, content)
        return frame

    @staticmethod
    def _check_source(frame: Frame, item: Observation | Checkpoint) -> None:
        """Raise MessageRefused if the observer is not the sender."""
        if item.source != (frame.sender, frame.incarnation):
            raise MessageRefused(
                RefusalReason.SOURCE,
                f"a frame of vehicle {frame.sender} (incarnation {frame.incarnation}) has observations of "
                f"vehicle {item.observer} (incarnation {item.incarnation})",
            )
