"""Authentication of requests to a process: operators' commands, and payloads' reports."""

from __future__ import annotations

from typing import Protocol


class NotAuthorised(Exception):
    """A request that the sender cannot sign; it was not sent. The text has the remedy."""


class Authentication(Protocol):
    """The check of a request's sender, and the signature of the answer."""

    @property
    def is_cheap(self) -> bool:
        """True if a check takes microseconds, so that the number of checks needs no limit."""

    def verify(self, key: str, payload: bytes) -> bytes:
        """Return the request in a payload under `key`. Raises BadMessage if the sender is not authorised."""

    def sign_answer(self, key: str, payload: bytes, answer: bytes) -> bytes:
        """Return the signed answer to a payload."""


class RequestSigning(Protocol):
    """The sender's side: the signature of requests, and the check of signed answers."""

    def sign(self, uav: int | None, key: str, request: bytes) -> bytes:
        """Return the signed payload of a request to vehicle `uav`; None: to the process of all vehicles.

        Raises NotAuthorised.
        """

    def verify_answer(self, uav: int | None, key: str, asked: bytes, data: bytes) -> bytes:
        """Return the answer to the payload `asked`. Raises BadMessage for a forged answer."""


class _None:
    is_cheap = False

    def verify(self, _key: str, payload: bytes) -> bytes:
        return payload

    def sign_answer(self, _key: str, _payload: bytes, answer: bytes) -> bytes:
        return answer

    def sign(self, _uav: int | None, _key: str, request: bytes) -> bytes:
        return request

    def verify_answer(self, _uav: int | None, _key: str, _asked: bytes, data: bytes) -> bytes:
        return data


NO_AUTHENTICATION = _None()
"""for a bus that no other process reaches, and for reports over links with certificates"""
