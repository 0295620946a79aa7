"""Whether a frame is its sender's, and of now. Pure."""

from __future__ import annotations

from swarmctl.bus.node.decoding import Reading
from swarmctl.bus.node.exchange import NodeOptions
from swarmctl.bus.node.ledger import STALE_S
from swarmctl.core.frames import Frame, Refused, Why


def check_source(reading: Reading, sender: int, act: str) -> None:
    """Raises Refused where it is not what `sender` says under this key."""
    frame = reading.frame
    if frame.sender != sender or reading.act != act:
        raise Refused(
            Why.SOURCE,
            f"a frame {reading.act} of vehicle {frame.sender} under the key of {act} of {sender}",
        )


def check_time(frame: Frame, unix_s: float, options: NodeOptions) -> None:
    """Raises Refused for what will be said only later."""
    ahead_s = frame.unix_s - unix_s
    if ahead_s > options.clock_tolerance_s:
        raise Refused(Why.FUTURE, f"said {ahead_s:.1f} s from now by the clock of vehicle {frame.sender}")


def check_age(frame: Frame, unix_s: float, options: NodeOptions) -> None:
    """Raises Refused for what was said long ago."""
    if is_stale(frame, unix_s, options):
        age_s = unix_s - frame.unix_s
        raise Refused(Why.REPLAY, f"said {age_s:.0f} s ago by the clock of vehicle {frame.sender}")


def is_stale(frame: Frame, unix_s: float, options: NodeOptions) -> bool:
    return unix_s - frame.unix_s > STALE_S + options.round_trip_s
