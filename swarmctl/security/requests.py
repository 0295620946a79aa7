"""Signed commands of an operator, safe from forgery, redirection and replay, and signed answers.

A signed command is 64 bytes of Ed25519 signature and a MessagePack map. The signature covers the swarm's
name and the map. The map has the command's bus key, so another vehicle refuses the command. An answer's
signature also covers a hash of the signed command.
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
MAX_COMMAND_AGE_S = 20.0
"""largest age of a command; an older command may no longer be right"""


class SignedCommand(msgspec.Struct, frozen=True):
    """A command, its bus key and its time."""

    key: Annotated[str, msgspec.Meta(max_length=200)]
    unix_s: float
    """time of the command; a verifier refuses a second command with the same time"""
    command: Annotated[bytes, msgspec.Meta(max_length=MAX_COMMAND_BYTES)]

    def __post_init__(self) -> None:
        if not math.isfinite(self.unix_s):
            raise ValueError("the time is not a finite number")


_encoder = msgspec.msgpack.Encoder()
_decoder = msgspec.msgpack.Decoder(SignedCommand)


def _signed_command_bytes(swarm: str, body: bytes) -> bytes:
    return b"swarmctl request\0" + swarm.encode() + b"\0" + body


def sign_command(
    swarm: str, key: str, command: bytes, unix_s: float, sign: Callable[[bytes], bytes]
) -> bytes:
    """Return the signed payload of a command under the bus key `key`."""
    body = _encoder.encode(SignedCommand(key, unix_s, command))
    return sign(_signed_command_bytes(swarm, body)) + body


def _signed_answer_bytes(swarm: str, key: str, asked: bytes, answer: bytes) -> bytes:
    asked_hash = hashlib.sha256(asked).digest()  # The constant length separates the hash from the answer.
    return b"swarmctl answer\0" + swarm.encode() + b"\0" + key.encode() + b"\0" + asked_hash + answer


def sign_answer(swarm: str, key: str, asked: bytes, answer: bytes, sign: Callable[[bytes], bytes]) -> bytes:
    """Return the signed answer to the payload `asked` under `key`."""
    return sign(_signed_answer_bytes(swarm, key, asked, answer)) + answer


def verify_answer(
    swarm: str, key: str, asked: bytes, data: bytes, verify: Callable[[bytes, bytes], bool]
) -> bytes:
    """Return the answer to `asked`; `verify` checks the vehicle's signature. Raises BadMessage."""
    signature, answer = data[:SIGNATURE_BYTES], data[SIGNATURE_BYTES:]
    if not verify(signature, _signed_answer_bytes(swarm, key, asked, answer)):
        raise BadMessage("the answer is not signed by the vehicle")
    return answer


class CommandVerifier:
    """Verifier of commands to an agent: checks signature, bus key and time, and refuses repeated commands.

    verify: function that checks the operator's signature
    began_unix_s: start of this process; commands from before may have been executed by another process
    tolerance_s: greatest time by which the operator's clock may be ahead [s]
    """

    def __init__(
        self, swarm: str, verify: Callable[[bytes, bytes], bool], began_unix_s: float, tolerance_s: float
    ) -> None:
        self._swarm = swarm
        self._verify = verify
        self._began_unix_s = began_unix_s
        self._tolerance_s = tolerance_s
        self._accepted_unix_s: set[float] = set()

    def verify(self, key: str, data: bytes, unix_s: float) -> bytes:
        """Return the command. Raises BadMessage, and no other exception, for a refused payload."""
        signature, body = data[:SIGNATURE_BYTES], data[SIGNATURE_BYTES:]
        if not self._verify(signature, _signed_command_bytes(self._swarm, body)):
            raise BadMessage(
                "the command is not signed by the operator of this swarm; use the operator's keys "
                "[not-signed]"
            )
        try:
            signed = _decoder.decode(body)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise BadMessage(f"the payload is not a signed command: {error}") from None
        if signed.key != key:
            raise BadMessage(f"the command is for the key {signed.key}, but arrived under {key}")
        self._check_time(signed.unix_s, unix_s)
        self._accepted_unix_s = {at_s for at_s in self._accepted_unix_s if at_s > unix_s - MAX_COMMAND_AGE_S}
        if signed.unix_s in self._accepted_unix_s:
            raise BadMessage("the same command was received before: a replay [command-replayed]")
        self._accepted_unix_s.add(signed.unix_s)
        return signed.command

    def _check_time(self, given_unix_s: float, unix_s: float) -> None:
        age_s = unix_s - given_unix_s
        if age_s < -self._tolerance_s:
            raise BadMessage(
                f"the command's time is {-age_s:.0f} s ahead of this machine's clock; check the clocks of "
                "both machines [command-early]"
            )
        if given_unix_s < self._began_unix_s:
            before_s = self._began_unix_s - given_unix_s
            raise BadMessage(
                f"the command was given {before_s:.1f} s before this agent started; repeat the command. If "
                "this fails too, check the clocks of both machines [command-before-start]"
            )
        if age_s > MAX_COMMAND_AGE_S:
            raise BadMessage(
                f"the command is {age_s:.0f} s old (limit {MAX_COMMAND_AGE_S:g} s); check the clocks of both "
                "machines [command-old]"
            )
