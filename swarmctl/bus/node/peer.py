"""State that a UAV keeps about another UAV, and checks of that UAV's messages. No I/O."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import msgspec
import numpy as np
from msgspec import field

from swarmctl.bus.node.decoding import DecodedFrame
from swarmctl.bus.node.exchange import STALE_S, NewestT, NodeOptions
from swarmctl.bus.node.replica import Replica
from swarmctl.bus.rate import TokenBucket
from swarmctl.core.frames import (
    Content,
    Frame,
    IntentShared,
    MemberShared,
    MessageRefused,
    RefusalReason,
    StateShared,
)
from swarmctl.core.geo import LatLon, distances_m
from swarmctl.core.records import replace

SILENT_AFTER_S = 5.0
"""silence of a UAV after which its next message causes a request for missed observations"""
RANKED_LAST_AFTER_S = 20.0
"""time without direct or relayed news after which a UAV ranks last among the receivers"""
BYTES_PER_S, BYTES_BURST = 800_000.0, 8_000_000
"""limit on the bytes from one sender: in the long run [1/s], and at once"""
WORK_PER_S, WORK_BURST = 1000.0, 10_000
"""limit on the steps of work that one sender causes"""
WORK_PER_MESSAGE = 5
WORK_PER_OBSERVATION, WORK_PER_OTHER_FRAME = 1, 20
"""steps of work for a frame inside a message, in addition to the steps for the message"""
REQUESTS_PER_S, REQUESTS_BURST = 4.0, 16
"""limit on the requests of one sender"""
REPLAY_WINDOW = 1024
"""number of later messages of the same sender after which a late message counts as a replay"""
REPLAY_WINDOW_MASK = (1 << REPLAY_WINDOW) - 1
MIN_STATE_LEAD_S = 1.0
"""smallest lead of a state over the requester's state for which the state is sent"""


def check_message(sender: int, act: str, frame: Frame, unix_s: float, options: NodeOptions) -> None:
    """Raise MessageRefused if a frame differs from its key, is stale, or is from the future."""
    if (frame.sender, frame.act) != (sender, act):
        raise MessageRefused(
            RefusalReason.SOURCE,
            f"the frame is {frame.act} of vehicle {frame.sender}, but the key is {act} of vehicle {sender}",
        )
    check_time(frame, unix_s, options)
    if (age_s := unix_s - frame.unix_s) > options.max_age_s:
        raise MessageRefused(
            RefusalReason.REPLAY, f"the message is {age_s:.0f} s old by the clock of vehicle {frame.sender}"
        )


def check_time(frame: Frame, unix_s: float, options: NodeOptions) -> None:
    """Raise MessageRefused if the frame's time is in the future by more than the clocks' tolerance."""
    ahead_s = frame.unix_s - unix_s
    if ahead_s > options.clock_tolerance_s:
        raise MessageRefused(
            RefusalReason.FUTURE,
            f"the clock of vehicle {frame.sender} is {ahead_s:.1f} s ahead of this machine's "
            f"(limit {options.clock_tolerance_s:g} s)",
        )


def too_fast(limit: TokenBucket, unit: str) -> MessageRefused:
    return MessageRefused(
        RefusalReason.TOO_FAST, f"the messages need more than {limit.per_s:g} {unit} a second"
    )


class PeerRecord(msgspec.Struct, gc=False):
    """The known state of another UAV, without reference cycles, so the garbage collector can skip it."""

    incarnation: int = -1
    """incarnation in the newest message; -1: no message received"""
    last_n: int = 0
    """greatest number of a message of this incarnation"""
    missing: int = 0
    """bit i: message `last_n` - i has not arrived; sets instead of bits took 1 GB for a hundred UAVs"""
    received_s: float = -math.inf
    """time of the last direct message"""
    bytes_limit: TokenBucket = field(default_factory=lambda: TokenBucket(BYTES_PER_S, BYTES_BURST))
    work_limit: TokenBucket = field(default_factory=lambda: TokenBucket(WORK_PER_S, WORK_BURST))
    request_limit: TokenBucket = field(default_factory=lambda: TokenBucket(REQUESTS_PER_S, REQUESTS_BURST))
    newest: dict[type[Content], DecodedFrame] = {}
    """newest known state, intent and member message, each received directly or relayed"""
    untaken: set[type[Content]] = set()
    """kinds of messages of `newest` that the agent has not taken yet"""
    state: StateShared | None = None
    """content of the newest state; read for each peer and each sent message"""
    state_s: float = -math.inf
    """reception time of the newest state"""
    direct_state_s: float = -math.inf
    """reception time of the last direct state; -inf after `record_missing`"""
    agreed_s: float = -math.inf
    """time of the last direct state without news for this UAV; -inf if an observation is missing"""

    def admit(self, frame: Frame, now_s: float) -> bool:
        """Accept a message; return whether it is the first of its incarnation, or the first after a silence.

        Raises MessageRefused for a repeated message, for an earlier incarnation, and above the rate limit.
        """
        n = frame.n
        if frame.incarnation != self.incarnation:
            if frame.incarnation < self.incarnation:
                raise MessageRefused(
                    RefusalReason.REPLAY, f"message {n} is older than the restart of vehicle {frame.sender}"
                )
            self.incarnation, self.last_n, self.missing = frame.incarnation, 0, 0
            self.received_s = -math.inf
        ahead = n - self.last_n
        if ahead <= 0 and (ahead <= -REPLAY_WINDOW or not self.missing >> -ahead & 1):
            raise MessageRefused(
                RefusalReason.REPLAY, f"message {n} of vehicle {frame.sender} arrived before, or is too late"
            )
        # The rate limit comes last: replayed messages must not use up the sender's rate.
        if not self.work_limit.try_take(now_s, WORK_PER_MESSAGE):
            raise too_fast(self.work_limit, "steps of work")
        if ahead > 0:
            self.last_n = n
            if self.missing or ahead > 1:
                # All messages of the gap are missing, up to the size of the window.
                shift = min(ahead, REPLAY_WINDOW)
                self.missing = (self.missing << shift | (1 << shift) - 2) & REPLAY_WINDOW_MASK
        else:
            self.missing ^= 1 << -ahead
        was_silent = now_s - self.received_s > SILENT_AFTER_S
        self.received_s = now_s
        return was_silent

    def update(self, decoded: DecodedFrame, now_s: float) -> None:
        """Store a state, intent or member message, unless it is old."""
        frame, content = decoded.frame, decoded.frame.content
        before = self.newest.get(type(content))
        if frame.incarnation < self.incarnation or (
            before is not None and frame.unix_s <= before.frame.unix_s
        ):
            return
        if isinstance(content, StateShared):
            self.state, self.state_s = content, now_s
        elif isinstance(content, MemberShared) and before is not None:
            # The agent may not have taken the message before, which may have had the route.
            with_route = content.with_route_of(before.frame.content)  # type: ignore[arg-type]
            if with_route is not content:
                decoded = replace(decoded, frame=replace(frame, content=with_route))
        self.newest[type(content)] = decoded
        self.untaken.add(type(content))

    def take(self, kind: type[NewestT]) -> tuple[float, NewestT]:
        """Return the untaken message of a kind with its unix time [s]."""
        self.untaken.remove(kind)
        frame = self.newest[kind].frame
        return frame.unix_s, frame.content  # type: ignore[return-value]

    def record_missing(self) -> None:
        """Record that the peer has observations that are missing here, and ignore the peer's last state."""
        self.direct_state_s = self.agreed_s = -math.inf

    def agrees(self, replica: Replica, now_s: float) -> bool:
        """Return whether the peer's recent states show no observation that is missing in `replica`."""
        if now_s - self.agreed_s <= SILENT_AFTER_S:
            return True
        if self.state is None or now_s - self.direct_state_s > SILENT_AFTER_S:
            return False
        return replica.has_held(self.state.knows)

    def is_ranked_last(self, now_s: float) -> bool:
        """Return whether the peer's state is known, but no news since `RANKED_LAST_AFTER_S`."""
        latest_s = max(self.received_s, self.state_s)
        return self.state is not None and now_s - latest_s > RANKED_LAST_AFTER_S


def nearest_uavs(
    position: LatLon | None, peers: Mapping[int, PeerRecord], k: int | None, now_s: float
) -> tuple[int, ...]:
    """Return the `k` of `peers` that are nearest to `position`, without UAVs in the phase `failed`.

    The paper defines the communication range as a number of UAVs. UAVs without a known position come after
    UAVs with a position, and UAVs that are `is_ranked_last` come last; equal UAVs come in the order of system
    ids. If `k` is None or not below the number of UAVs, the result is all UAVs in the order of `peers`.
    """
    states = {
        uav: state for uav, peer in peers.items() if (state := peer.state) is None or state.phase != "failed"
    }
    if k is None or k >= len(states):
        return tuple(states)
    metres = dict.fromkeys(states, math.inf)
    known = {u: state for u, state in states.items() if state is not None}
    if position is not None and known:
        lat_deg, lon_deg = np.array([(state.lat_deg, state.lon_deg) for state in known.values()]).T
        metres.update(zip(known, distances_m(position, lat_deg, lon_deg).tolist(), strict=True))
    return tuple(sorted(states, key=lambda u: (peers[u].is_ranked_last(now_s), metres[u], u))[:k])


def states_since(peers: Iterable[PeerRecord], known: Mapping[int, float], unix_s: float) -> list[bytes]:
    """Return the frames of states newer than `known` (UAV -> unix [s]), and these UAVs' recent intents."""
    newer = [
        (decoded, peer.newest.get(IntentShared))
        for peer in peers
        if (decoded := peer.newest.get(StateShared)) is not None
        and decoded.frame.unix_s > known.get(decoded.frame.sender, -math.inf) + MIN_STATE_LEAD_S
    ]
    recent = [intent for _, intent in newer if intent and unix_s - intent.frame.unix_s <= STALE_S]
    return [state.data for state, _ in newer] + [intent.data for intent in recent]
