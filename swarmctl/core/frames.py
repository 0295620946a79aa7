"""What UAVs tell each other, typed as the acts of FIPA's agent communication language, and its bytes.

| act/kind | content | says |
|---|---|---|
| `inform/observation` | Observation | what the sender has just seen |
| `inform/state` | StateShared | where it is, what it does, what it knows, whom it hears; once a second |
| `inform/intent` | IntentShared | where it will be at what time; when that changes, and every few seconds |
| `query-ref/snapshot` | SnapshotAsked | which observations it holds: tell me the others |
| `inform/snapshot` | Snapshot | the answer: frames of their observers, word for word |
| `inform/relayed` | Relayed | frames of others, passed on at once; or a checkpoint of the sender's |
| `inform/checkpoint` | Checkpoint | in snapshots: stands for all an observer saw up to one observation |

A frame is the byte VERSION, a byte that says whether it is signed, then 64 bytes of Ed25519 signature if it
is, then a MessagePack map. What is signed is the swarm's name and the map. Fields that a later version adds
are tolerated; another version, a missing field or a value that makes no sense is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import StrEnum
from typing import Annotated

import msgspec

from swarmctl.core.geo import LatLon
from swarmctl.core.observation import Checkpoint, Id, Incarnation, Observation, Seq

VERSION = 3
UNSIGNED, SIGNED = 0, 1
SIGNATURE_BYTES = 64
MAX_FRAME_BYTES = 49_152
"""longer ones are cut into several, or refused"""
MAX_INNER_BYTES = MAX_FRAME_BYTES - 8192
"""of what is passed on inside of another message"""
MAX_TEXT = 200

MAX_POINTS = 256
"""of an intent: of what is longer the begin is told"""
MAX_AHEAD_S = 14_400.0
"""so far ahead an intent may tell"""
MAX_AWAY = 1e7
"""No height, distance [m] or speed [m/s] that is told is greater: autopilots tell none above 2.2e6. What is
reckoned with stays a number."""
MAX_HEARD = 254
"""as many as there are system ids"""
MAX_FRAMES = 256
"""inside of one message"""

Frames = Annotated[tuple[bytes, ...], msgspec.Meta(max_length=MAX_FRAMES)]
Text = Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]


class RefusalReason(StrEnum):
    """Why a message was refused."""

    MALFORMED = "malformed"
    OVERSIZE = "oversize"
    VERSION = "other version"
    UNSIGNED = "not signed"
    SIGNATURE = "wrong signature"
    WILDCARD = "wildcard key"
    SOURCE = "wrong source"
    """the key, the frame and its content do not name one sender"""
    STRANGER = "not of this swarm"
    REPLAY = "replay"
    FUTURE = "from the future"
    OUTSIDE = "outside the area"
    TWO_CONTENTS = "two contents"
    TOO_FAST = "too fast"


class MessageRefused(ValueError):
    """A message that is not taken; says why in a word, and what was found."""

    def __init__(self, why: RefusalReason, text: str) -> None:
        super().__init__(f"{why}: {text}")
        self.why = why


def _check_place(lat_deg: float, lon_deg: float) -> None:
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0):
        raise ValueError(f"a UAV at ({lat_deg}, {lon_deg}): expected degrees")


class StateShared(msgspec.Struct, frozen=True, omit_defaults=True, gc=False, tag="inform/state"):
    """Where a UAV is, what it is doing and how much it knows, about once a second of its own time."""

    time_s: float
    """by the vehicle's clock since boot [s]"""
    lat_deg: float
    lon_deg: float
    alt_rel_m: float
    phase: Text
    n_observed: int
    n_found: int
    last_seq: int = 0
    """its last own observation"""
    knows: int = 0
    """a hash over the names of all it holds"""
    mode: Text = ""
    plan_id: int = 0
    replans: int = 0
    late_s: float | None = None
    outcome: Text = ""
    trouble: Text = ""
    refused: int = 0
    """messages it did not take"""
    flagged: tuple[int, ...] = ()
    """UAVs that told the contrary of what it saw itself"""
    alt_amsl_m: float | None = None
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """east, north, up"""
    earliest_in_s: float | None = None
    """until it could be over its goal; negative: since it was; where a swarm arrives together"""
    hears: Annotated[tuple[Id, ...], msgspec.Meta(max_length=MAX_HEARD)] = ()
    """of the UAVs near it, those it has heard of late: they know by it that they are heard"""
    returns_to: tuple[float, float] | None = None
    """where it goes down: of who is on the way home, or holds until its turn to be [deg]"""
    age_s: float = 0.0
    """how old its place, height and velocity are, where it tells none any more"""

    def __post_init__(self) -> None:
        _check_place(self.lat_deg, self.lon_deg)
        if self.returns_to is not None:
            _check_place(*self.returns_to)
        maybe = (self.late_s, self.alt_amsl_m, self.earliest_in_s)
        own = (self.time_s, self.alt_rel_m, *self.velocity_m_s)
        numbers = (*own, self.age_s, *(x for x in maybe if x is not None))
        if not all(map(math.isfinite, numbers)) or self.age_s < 0.0:
            raise ValueError("a time, a height, a speed or an age that is no number, or below 0")
        if max(map(abs, (self.alt_rel_m, self.alt_amsl_m or 0.0, *self.velocity_m_s))) > MAX_AWAY:
            raise ValueError(f"a height or a speed of more than {MAX_AWAY:g}")


class IntentPoint(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """Where a UAV will be."""

    in_s: float
    """from when its frame was said (`Frame.unix_s`), in seconds of the vehicles' time"""
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class IntentShared(msgspec.Struct, frozen=True, omit_defaults=True, gc=False, tag="inform/intent"):
    """The flight that a UAV is on or is about to begin: straight from point to point."""

    plan_id: int
    """of its plan, as in its state; 0: it flies none"""
    points: Annotated[tuple[IntentPoint, ...], msgspec.Meta(max_length=MAX_POINTS)] = ()
    """times rising; none: where it flies is not known"""
    may_change: bool = True
    """it could give way: it flies a mission of ours that may be changed"""
    around_m: tuple[float, float] = (0.0, 0.0)
    """it is somewhere within this of these points, over ground and in height"""
    on_ground: bool = False
    """it is about to take off"""

    def __post_init__(self) -> None:
        if not all(0.0 <= m <= MAX_AWAY for m in self.around_m):
            raise ValueError(f"a distance that is no number, below 0 or above {MAX_AWAY:g}")
        before_s = -math.inf
        for point in self.points:
            _check_place(point.lat_deg, point.lon_deg)
            if not (abs(point.alt_amsl_m) <= MAX_AWAY and 0.0 <= point.in_s <= MAX_AHEAD_S):
                raise ValueError(
                    f"a height that is no number or above {MAX_AWAY:g}, or a time that is not ahead"
                )
            if point.in_s <= before_s:
                raise ValueError("times that do not rise: expected each after the one before")
            before_s = point.in_s


class HeldObservations(msgspec.Struct, frozen=True, array_like=True):
    """What of one source is held."""

    observer: Id
    incarnation: Incarnation
    checkpoint: int
    """what the checkpoint held stands for; 0: there is none"""
    upto: int
    """everything up to here"""
    beyond: tuple[Seq, ...] = ()
    """and of what came later, these"""
    mark: int = 0
    """of all of them (`swarmctl.core.observation.mark_of`)"""


class SnapshotAsked(msgspec.Struct, frozen=True, tag="query-ref/snapshot"):
    """Everything held, by name."""

    have: tuple[HeldObservations, ...]
    states: tuple[tuple[Id, float], ...]
    """UAV -> the time of its last state held (unix) [s]"""


class Snapshot(msgspec.Struct, frozen=True, tag="inform/snapshot"):
    """Part of the answer to a `SnapshotAsked`."""

    frames: Frames
    last: bool


class Relayed(msgspec.Struct, frozen=True, tag="inform/relayed"):
    """Frames of others that were new to the sender, or a checkpoint of its own."""

    frames: Frames


Content = Observation | Checkpoint | StateShared | IntentShared | SnapshotAsked | Snapshot | Relayed
AgentMessage = Observation | StateShared | IntentShared
"""what an agent says; all else is between its node and others'"""


class Frame(msgspec.Struct, frozen=True, omit_defaults=True, gc=False):
    """A message with whom it comes from; the same bytes to whomever it goes."""

    sender: Id
    incarnation: Incarnation
    n: Seq
    """counts the messages of this sender's incarnation"""
    unix_s: float
    """when it was said"""
    content: Content
    lat_deg: float | None = None
    lon_deg: float | None = None
    """where it was said, unless the content tells"""

    def __post_init__(self) -> None:
        if not math.isfinite(self.unix_s):
            raise ValueError("a time that is no number")
        if self.lat_deg is not None and self.lon_deg is not None:
            _check_place(self.lat_deg, self.lon_deg)

    @property
    def at(self) -> LatLon | None:
        content = self.content
        if isinstance(content, StateShared):
            return content.lat_deg, content.lon_deg
        return None if self.lat_deg is None or self.lon_deg is None else (self.lat_deg, self.lon_deg)

    @property
    def act(self) -> str:
        """act/kind, as in its key"""
        return act_of(self.content)


def act_of(content: Content) -> str:
    return str(type(content).__struct_config__.tag)


Sign = Callable[[int, bytes], bytes | None]
"""(sender, what is signed) -> signature; None where nobody signs"""
Verify = Callable[[int, bytes, bytes], bool]
"""(sender, signature, what is signed) -> whether it is that sender's"""

_encoder = msgspec.msgpack.Encoder()
_frames: msgspec.msgpack.Decoder[Frame] = msgspec.msgpack.Decoder(Frame)


class FrameCodec:
    """Frames to bytes and back. Without `verify` signatures are neither made nor looked at."""

    def __init__(self, swarm: str, sign: Sign | None = None, verify: Verify | None = None) -> None:
        self._domain = b"swarmctl\0" + swarm.encode() + b"\0"
        self._sign = sign
        self._verify = verify

    def close(self, frame: Frame) -> bytes:
        """The bytes of a frame of this process's own."""
        body = _encoder.encode(frame)
        signature = None if self._sign is None else self._sign(frame.sender, self._domain + body)
        if signature is None:
            return bytes((VERSION, UNSIGNED)) + body
        return bytes((VERSION, SIGNED)) + signature + body

    def open(self, data: bytes) -> Frame:
        """Raises Refused; never anything else, whatever the bytes."""
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
    def _check_source(frame: Frame, told: Observation | Checkpoint) -> None:
        """Nobody speaks for another: what it tells it has seen itself."""
        if told.source != (frame.sender, frame.incarnation):
            raise MessageRefused(
                RefusalReason.SOURCE, f"vehicle {frame.sender} tells what {told.observer} saw as its own"
            )
