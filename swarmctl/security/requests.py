"""Signed requests of operators and payloads, safe from forgery, redirection and replay, and signed answers.

A signed request is 64 bytes of signature, a line of JSON with bus key and time, and the request:

    SIGNATURE {"key":"swarmctl/demo/uav/3/inform/look/sensor","unix_s":1767225600.25} NEWLINE REQUEST

The signature is Ed25519 by the operator's key, or HMAC-SHA512 by the token of the flight. It covers the text
`swarmctl request`, a zero byte, the swarm's name, a zero byte, and everything after the signature. Because of
the bus key another vehicle refuses the request. An answer's signature also covers a hash of the request.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

import msgspec

from swarmctl.bus.authentication import NotAuthorised
from swarmctl.core.frames import SIGNATURE_BYTES
from swarmctl.core.messages import BadMessage
from swarmctl.security.participant import Keyring
from swarmctl.security.token import TOKEN_FILE, Token

MAX_REQUEST_AGE_S = 20.0
"""largest age of a request; an older request may no longer be right"""
NOT_SIGNED = "the command is not signed by the operator of this swarm; use the operator's keys [not-signed]"
WRONG_TOKEN = (
    "the request does not have the token of this flight; send it as the user of the flight, or set "
    f"{TOKEN_FILE} for both [wrong-token]"
)
Sign = Callable[[bytes], bytes]
Verify = Callable[[bytes, bytes], bool]
"""function of (signature, data)"""


class _Header(msgspec.Struct, frozen=True):
    """The bus key of a request, and its time."""

    key: Annotated[str, msgspec.Meta(max_length=200)]
    unix_s: float


_encoder = msgspec.json.Encoder()
_decoder = msgspec.json.Decoder(_Header)


def _signed_request_bytes(swarm: str, body: bytes) -> bytes:
    return b"swarmctl request\0" + swarm.encode() + b"\0" + body


def sign_request(swarm: str, key: str, request: bytes, unix_s: float, sign: Sign) -> bytes:
    """Return the signed payload of a request under the bus key `key`."""
    body = _encoder.encode(_Header(key, unix_s)) + b"\n" + request
    return sign(_signed_request_bytes(swarm, body)) + body


def _signed_answer_bytes(swarm: str, key: str, asked: bytes, answer: bytes) -> bytes:
    asked_hash = hashlib.sha256(asked).digest()  # The constant length separates the hash from the answer.
    return b"swarmctl answer\0" + swarm.encode() + b"\0" + key.encode() + b"\0" + asked_hash + answer


def sign_answer(swarm: str, key: str, asked: bytes, answer: bytes, sign: Sign) -> bytes:
    """Return the signed answer to the payload `asked` under `key`."""
    return sign(_signed_answer_bytes(swarm, key, asked, answer)) + answer


def verify_answer(swarm: str, key: str, asked: bytes, data: bytes, verify: Verify) -> bytes:
    """Return the answer to `asked`; `verify` checks the receiver's signature. Raises BadMessage."""
    signature, answer = data[:SIGNATURE_BYTES], data[SIGNATURE_BYTES:]
    if not verify(signature, _signed_answer_bytes(swarm, key, asked, answer)):
        raise BadMessage("the answer is not signed by the receiver of the request")
    return answer


@dataclass(slots=True)
class SignedRequests:
    """The receiver's side: checks signature, key and time, refuses repeated requests, and signs answers."""

    swarm: str
    is_signed: Verify
    """function that checks the sender's signature"""
    sign: Sign
    clock: Callable[[], float]
    """wall clock [s since 1970]"""
    tolerance_s: float
    """greatest time by which the sender's clock may be ahead [s]"""
    is_cheap: bool
    """True for the HMAC of a token, False for Ed25519"""
    unsigned: str = NOT_SIGNED
    """reason for the refusal of a wrong signature"""
    _began_unix_s: float = field(init=False)
    """start of this process; requests from before may have been executed by another process"""
    _accepted: dict[int, set[bytes]] = field(default_factory=dict, init=False)
    """hashes of the accepted requests, by the whole seconds of their time"""

    def __post_init__(self) -> None:
        self._began_unix_s = self.clock()

    def sign_answer(self, key: str, payload: bytes, answer: bytes) -> bytes:
        return sign_answer(self.swarm, key, payload, answer, self.sign)

    def verify(self, key: str, payload: bytes) -> bytes:
        """Return the request. Raises BadMessage, and no other exception, for a refused payload."""
        signature, body = payload[:SIGNATURE_BYTES], payload[SIGNATURE_BYTES:]
        if not self.is_signed(signature, _signed_request_bytes(self.swarm, body)):
            raise BadMessage(self.unsigned)
        line, newline, request = body.partition(b"\n")
        try:
            header = _decoder.decode(line)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise BadMessage(f"the payload is not a signed request: {error}") from None
        if not newline:
            raise BadMessage("the payload is not a signed request: the line with key and time does not end")
        if header.key != key:
            raise BadMessage(f"the request is for the key {header.key}, but arrived under {key}")
        unix_s = self.clock()
        self._check_time(header.unix_s, unix_s)
        self._check_is_new(header.unix_s, hashlib.sha256(body).digest(), unix_s)
        return request

    def _check_is_new(self, given_unix_s: float, request_hash: bytes, unix_s: float) -> None:
        for second in [s for s in self._accepted if s + 1.0 < unix_s - MAX_REQUEST_AGE_S]:
            del self._accepted[second]
        accepted = self._accepted.setdefault(math.floor(given_unix_s), set())
        if request_hash in accepted:
            raise BadMessage("the same request was received before: a replay [command-replayed]")
        accepted.add(request_hash)

    def _check_time(self, given_unix_s: float, unix_s: float) -> None:
        age_s = unix_s - given_unix_s
        if age_s < -self.tolerance_s:
            raise BadMessage(
                f"the request's time is {-age_s:.0f} s ahead of this machine's clock; check the clocks of "
                "both machines [command-early]"
            )
        if given_unix_s < self._began_unix_s:
            before_s = self._began_unix_s - given_unix_s
            raise BadMessage(
                f"the request was given {before_s:.1f} s before this process started; repeat it. If this "
                "fails too, check the clocks of both machines [command-before-start]"
            )
        if age_s > MAX_REQUEST_AGE_S:
            raise BadMessage(
                f"the request is {age_s:.0f} s old (limit {MAX_REQUEST_AGE_S:g} s); check the clocks of both "
                "machines [command-old]"
            )


def by_operator(
    swarm: str, keyring: Keyring, tolerance_s: float, clock: Callable[[], float]
) -> SignedRequests:
    """Return the authentication of an agent with keys: requests of the operator, answers of the vehicle."""
    is_signed, sign = keyring.is_signed_by_operator, keyring.signing_key.sign
    return SignedRequests(swarm, is_signed, sign, clock, tolerance_s, is_cheap=False)


def by_token(swarm: str, token: Token, tolerance_s: float, clock: Callable[[], float]) -> SignedRequests:
    """Return the authentication of a process without keys: all who have its token."""
    return SignedRequests(swarm, token.verify, token.sign, clock, tolerance_s, True, WRONG_TOKEN)


class OperatorSigning(msgspec.Struct, frozen=True):
    """The signing of requests with the operator's keys, and the check of the vehicles' signed answers."""

    swarm: str
    keyring: Keyring
    clock: Callable[[], float]

    def sign(self, _uav: int | None, key: str, request: bytes) -> bytes:
        return sign_request(self.swarm, key, request, self.clock(), self.keyring.signing_key.sign)

    def verify_answer(self, uav: int | None, key: str, asked: bytes, data: bytes) -> bytes:
        if uav is None:
            raise BadMessage("a process that flies all vehicles has no key")
        return verify_answer(self.swarm, key, asked, data, partial(self.keyring.verify, uav))


class TokenSigning(msgspec.Struct, frozen=True):
    """The signing of requests with the receivers' tokens, and the check of their signed answers."""

    swarm: str
    tokens: Mapping[int, Token]
    """tokens of agents in separate processes, by system id of the vehicle"""
    other: Token | None
    """token of all other receivers: of the process that flies all vehicles, or of SWARMCTL_TOKEN_FILE"""
    clock: Callable[[], float]

    def sign(self, uav: int | None, key: str, request: bytes) -> bytes:
        return sign_request(self.swarm, key, request, self.clock(), self._token(uav).sign)

    def verify_answer(self, uav: int | None, key: str, asked: bytes, data: bytes) -> bytes:
        return verify_answer(self.swarm, key, asked, data, self._token(uav).verify)

    def _token(self, uav: int | None) -> Token:
        token = self.other if uav is None else self.tokens.get(uav, self.other)
        if token is None:
            raise NotAuthorised(
                "this user has no token for the receiver, so nothing was sent; run the command as the "
                f"user of the flight on its machine, or set {TOKEN_FILE} to one file for both [no-token]"
            )
        return token
