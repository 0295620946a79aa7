"""An operator's commands under seal: who gives them, for whom, and when, so that nobody can give one again.

A sealed command is 64 bytes of Ed25519 signature and a MessagePack map. What is signed is the swarm's name
and the map, which holds the key that is asked: a command to one vehicle is none to another. The vehicle's
answer is signed by the vehicle, together with what it was asked: it answers nothing else.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from typing import Annotated

import msgspec

from swarmctl.core.frames import SIGNATURE_BYTES
from swarmctl.core.messages import BadMessage

MAX_COMMAND_BYTES = 16_000
FRESH_S = 20.0
"""An older command is not taken: what was meant then may be wrong now."""


class Sealed(msgspec.Struct, frozen=True):
    """A command with its circumstances."""

    key: Annotated[str, msgspec.Meta(max_length=200)]
    unix_s: float
    """when it was given; no two are given at one time"""
    command: Annotated[bytes, msgspec.Meta(max_length=MAX_COMMAND_BYTES)]

    def __post_init__(self) -> None:
        if not math.isfinite(self.unix_s):
            raise ValueError("a time that is no number")


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(Sealed)


def _signed(swarm: str, body: bytes) -> bytes:
    return b"swarmctl request\0" + swarm.encode() + b"\0" + body


def seal(swarm: str, key: str, command: bytes, unix_s: float, sign: Callable[[bytes], bytes]) -> bytes:
    """The bytes to ask `key` with."""
    body = _encoder.encode(Sealed(key, unix_s, command))
    return sign(_signed(swarm, body)) + body


def _answer_signed(swarm: str, key: str, asked: bytes, answer: bytes) -> bytes:
    # Of equal length, whatever was asked. No two commands under seal are equal.
    question = hashlib.sha256(asked).digest()
    return b"swarmctl answer\0" + swarm.encode() + b"\0" + key.encode() + b"\0" + question + answer


def seal_answer(swarm: str, key: str, asked: bytes, answer: bytes, sign: Callable[[bytes], bytes]) -> bytes:
    """The bytes that answer `asked`, which came under `key`."""
    return sign(_answer_signed(swarm, key, asked, answer)) + answer


def open_answer(
    swarm: str, key: str, asked: bytes, data: bytes, verify: Callable[[bytes, bytes], bool]
) -> bytes:
    """What the vehicle of which `verify` knows the signatures answered to `asked`. Raises BadMessage."""
    signature, answer = data[:SIGNATURE_BYTES], data[SIGNATURE_BYTES:]
    if not verify(signature, _answer_signed(swarm, key, asked, answer)):
        raise BadMessage("an answer that the vehicle asked did not sign")
    return answer


class Opener:
    """What one agent takes of the operator: nothing unsigned, for others, of another time, or twice.

    `verify` tells whether the operator made a signature. Commands from before `began_unix_s`, when this
    process began, are too old: one that died may have taken them.
    """

    def __init__(
        self, swarm: str, verify: Callable[[bytes, bytes], bool], began_unix_s: float, tolerance_s: float
    ) -> None:
        self._swarm = swarm
        self._verify = verify
        self._began_unix_s = began_unix_s
        self._tolerance_s = tolerance_s
        self._taken: set[float] = set()

    def open(self, key: str, data: bytes, unix_s: float) -> bytes:
        """The command. Raises BadMessage; never anything else, whatever the bytes."""
        signature, body = data[:SIGNATURE_BYTES], data[SIGNATURE_BYTES:]
        if not self._verify(signature, _signed(self._swarm, body)):
            raise BadMessage("not signed by the operator of this swarm; give it with the operator's keys")
        try:
            sealed = _decoder.decode(body)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise BadMessage(f"no command under seal: {error}") from None
        if sealed.key != key:
            raise BadMessage(f"a command for {sealed.key}, asked under {key}")
        self._check_time(sealed.unix_s, unix_s)
        self._taken = {at_s for at_s in self._taken if at_s > unix_s - FRESH_S}
        if sealed.unix_s in self._taken:
            raise BadMessage("a replay: this command has come before")
        self._taken.add(sealed.unix_s)
        return sealed.command

    def _check_time(self, given_unix_s: float, unix_s: float) -> None:
        age_s = unix_s - given_unix_s
        if age_s < -self._tolerance_s:
            raise BadMessage(f"a command {-age_s:.0f} s from now: do the clocks of both machines go right?")
        if given_unix_s < self._began_unix_s:
            before_s = self._began_unix_s - given_unix_s
            raise BadMessage(
                f"a command from {before_s:.1f} s before this agent began: give it again; if that does not "
                "help, do the clocks of both machines go right?"
            )
        if age_s > FRESH_S:
            raise BadMessage(f"a command {age_s:.0f} s old: do the clocks of both machines go right?")
