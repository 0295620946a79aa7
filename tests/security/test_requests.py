"""Signed commands of an operator: an agent accepts valid ones, and no forgery or replay."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from hypothesis import given
from hypothesis import strategies as st

from swarmctl.core.messages import BadMessage
from swarmctl.security.requests import (
    MAX_REQUEST_AGE_S,
    SignedRequests,
    sign_answer,
    sign_request,
    verify_answer,
)

NOW = 1_800_000_000.0
KEY = "swarmctl/test/uav/3/request/order/operator"
OPERATOR = Ed25519PrivateKey.from_private_bytes(b"o" * 32)
UAV = Ed25519PrivateKey.from_private_bytes(b"u" * 32)


def verify_with(key: Ed25519PrivateKey) -> Callable[[bytes, bytes], bool]:
    def is_signed(signature: bytes, data: bytes) -> bool:
        try:
            key.public_key().verify(signature, data)
        except InvalidSignature:
            return False
        return True

    return is_signed


class Agent:
    """A receiver of requests that began at a time, and its clock."""

    def __init__(
        self, began_unix_s: float = NOW - 100.0, is_signed: Callable[[bytes, bytes], bool] | None = None
    ) -> None:
        self._now = began_unix_s
        is_signed = is_signed or verify_with(OPERATOR)
        self._requests = SignedRequests("test", is_signed, UAV.sign, lambda: self._now, 5.0, is_cheap=False)

    def verify(self, key: str, data: bytes, now: float) -> bytes:
        self._now = now
        return self._requests.verify(key, data)


def signed(
    unix_s: float = NOW, key: str = KEY, by: Ed25519PrivateKey = OPERATOR, swarm: str = "test"
) -> bytes:
    return sign_request(swarm, key, b"land", unix_s, by.sign)


def timeless() -> bytes:
    body = b'{"key":"%s","unix_s":1e999}\nland' % KEY.encode()
    return OPERATOR.sign(b"swarmctl request\0test\0" + body) + body


def test_a_command_of_the_operator_is_accepted() -> None:
    agent = Agent()
    assert agent.verify(KEY, signed(NOW), NOW + 1.0) == b"land"
    assert agent.verify(KEY, signed(NOW + 0.5), NOW + 1.0) == b"land"


REFUSED = {
    "no signature": (b"land", "not-signed"),
    "nothing": (b"", "not-signed"),
    "a UAV's": (signed(by=UAV), "not-signed"),
    "of another swarm": (signed(swarm="other"), "not-signed"),
    "changed on its way": (signed()[:-1] + b"!", "not-signed"),
    "for another vehicle": (signed(key=KEY.replace("/3/", "/4/")), "swarmctl/test/uav/4"),
    "old": (signed(NOW - MAX_REQUEST_AGE_S - 1.0), "21 s.*command-old"),
    "from the future": (signed(NOW + 6.0), "6 s.*command-early"),
    "no time": (timeless(), "out of range"),
}


@pytest.mark.parametrize(("data", "reason"), REFUSED.values(), ids=REFUSED)
def test_an_invalid_command_is_refused(data: bytes, reason: str) -> None:
    with pytest.raises(BadMessage, match=reason):
        Agent().verify(KEY, data, NOW)


def test_a_command_is_accepted_once() -> None:
    agent, data = Agent(), signed()
    agent.verify(KEY, data, NOW)
    with pytest.raises(BadMessage, match="command-replayed"):
        agent.verify(KEY, data, NOW + 1.0)
    with pytest.raises(BadMessage, match="command-old"):
        agent.verify(KEY, data, NOW + MAX_REQUEST_AGE_S + 1.0)


@pytest.mark.parametrize("down_s", [0.001, 3.0, 8.0])
def test_a_command_from_before_the_agents_start_is_refused(down_s: float) -> None:
    """The refusal also applies within the tolerance for differing clocks."""
    with pytest.raises(BadMessage, match="command-before-start"):
        Agent(began_unix_s=NOW + down_s).verify(KEY, signed(NOW), NOW + 10.0)


def test_an_answer_is_valid_for_its_vehicle_and_its_command_only() -> None:
    question = signed()
    answer = sign_answer("test", KEY, question, b"taken", UAV.sign)
    assert verify_answer("test", KEY, question, answer, verify_with(UAV)) == b"taken"
    other_key = KEY.replace("/3/", "/4/")
    for data, swarm, key, asked in (
        (sign_answer("test", KEY, question, b"taken", OPERATOR.sign), "test", KEY, question),
        (answer, "other", KEY, question),
        (answer, "test", other_key, question),
        (answer, "test", KEY, signed(NOW + 1.0)),
        (answer[:-1] + b"!", "test", KEY, question),
        (b"taken", "test", KEY, question),
        (b"", "test", KEY, question),
    ):
        with pytest.raises(BadMessage):
            verify_answer(swarm, key, asked, data, verify_with(UAV))


@given(st.binary(max_size=300))
def test_any_bytes_raise_bad_message_only(data: bytes) -> None:
    trusting = Agent(NOW, lambda *_: True)
    with pytest.raises(BadMessage):
        trusting.verify(KEY, b"s" * 64 + data, NOW)
