"""MAVLink 2 signing: what is signed without a key, and a key set, used and removed."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.facts import SIGNED, Heard
from sim_vehicle.conformance.guard import ALTER
from sim_vehicle.conformance.peer import STATION, Peer
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.words import CheckFailed, Skip, equal, holds, result_name

KEY = hashlib.sha256(b"sim_vehicle conformance").digest()
OTHER_KEY = hashlib.sha256(b"somebody else").digest()
Y2015_US = 1_420_070_400_000_000
STAMP = 50_000_000_000_000  # in the year 2030, where the vehicle does not know the date
REQUEST, VERSION = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
SIGNER, FORGER, PLAIN = (253, 190), (252, 190), (251, 190)
TAKE_BACK_ATTEMPTS = 5


def _sign_with(peer: Peer, source: tuple[int, int], key: bytes, stamp: int) -> None:
    """From now on a station of ours signs."""
    signing = peer.codec(source).signing
    signing.secret_key, signing.link_id, signing.timestamp, signing.sign_outgoing = key, 3, stamp, True


def _signed(entries: list[Heard]) -> list[Heard]:
    return [e for e in entries if e.raw[0] == 0xFD and e.raw[2] & SIGNED]


def _genuine(entry: Heard, key: bytes) -> bool:
    digest = hashlib.sha256(key + entry.raw[:-6]).digest()
    return entry.raw[-6:] == digest[:6]


@contextmanager
def _key_set(peer: Peer) -> Iterator[int]:
    """The vehicle has our key; Skip where it does not sign then."""
    unix_us = peer.request("SYSTEM_TIME").time_unix_usec
    stamp = (unix_us - Y2015_US) // 10 + 100 if unix_us > Y2015_US else STAMP + round(peer.now * 1e5)
    _sign_with(peer, SIGNER, KEY, stamp + 1000)
    with peer.owing("the signing key's absence", lambda: _take_back(peer)):
        peer.send(mavlink.MAVLink_setup_signing_message(*peer.target, KEY, stamp))
        mark = peer.wait(3.0)
        if not _signed(peer.heard[mark:]):
            raise Skip("does not sign after SETUP_SIGNING")
        yield stamp


def _take_back(peer: Peer) -> None:
    """Nothing acknowledges that a key is gone but that the vehicle no longer signs."""
    for _ in range(TAKE_BACK_ATTEMPTS):
        for source in (SIGNER, STATION):
            peer.send(mavlink.MAVLink_setup_signing_message(*peer.target, bytes(32), 0), source)
        peer.wait(1.0)
        mark = peer.wait(1.5)
        frames = peer.heard[mark:]
        if frames and not _signed(frames):
            return
    raise CheckFailed("expected it not to sign any more")


@check("signing.without_a_key")
def without_a_key(peer: Peer) -> str:
    """A vehicle without a key takes signed frames like others."""
    _sign_with(peer, FORGER, OTHER_KEY, STAMP)
    message = peer.command_long(REQUEST, VERSION)
    ack = peer.ask(message, "COMMAND_ACK", lambda m: m.command == REQUEST, source=FORGER)
    equal(result_name(ack.result), "ACCEPTED", "a signed command")
    return "ACCEPTED"


@check("signing.signs_what_it_sends", needs=[ALTER])
def signs(peer: Peer) -> str:
    """With a key every frame is signed, and the signatures are right."""
    with _key_set(peer):
        mark = peer.wait(3.0)
        frames = peer.heard[mark:]
        signed = _signed(frames)
        equal(len(signed), len(frames), "signed frames")
        wrong = [e.kind for e in signed if not _genuine(e, KEY)]
        holds(not wrong, f"wrong signatures on {sorted(set(wrong))}")
    return f"{len(signed)} frames"


@check("signing.stamps_go_up", needs=[ALTER])
def stamps_go_up(peer: Peer) -> str:
    """The time stamps of signatures go up."""
    with _key_set(peer):
        mark = peer.wait(3.0)
        stamps = [int.from_bytes(e.raw[-12:-6], "little") for e in _signed(peer.heard[mark:])]
    holds(all(b > a for a, b in pairwise(stamps)), "a stamp did not go up")
    return f"{len(stamps)} stamps"


@check("signing.takes_the_right_key", needs=[ALTER])
def takes_right_key(peer: Peer) -> str:
    """A command signed with the key is executed."""
    with _key_set(peer):
        ack = peer.ask(peer.command_long(REQUEST, VERSION), "COMMAND_ACK", source=SIGNER)
    equal(result_name(ack.result), "ACCEPTED", "a signed command")
    return "ACCEPTED"


def _obeyed(peer: Peer, data: bytes) -> bool:
    mark = peer.mark()
    peer.send_raw(data)
    return peer.maybe("COMMAND_ACK", within_s=1.5, mark=mark) is not None


def _need_distrust(peer: Peer) -> None:
    """Skip where this link is trusted: what need not be signed may be signed wrongly as well."""
    if _obeyed(peer, peer.pack(peer.command_long(REQUEST, VERSION), PLAIN)):
        raise Skip("this link is trusted: it takes unsigned frames")
    # A link that has lost the question is not one that refuses.
    peer.ask(peer.command_long(REQUEST, VERSION), "COMMAND_ACK", source=SIGNER)


@check("signing.refuses_unsigned", needs=[ALTER])
def refuses_unsigned(peer: Peer) -> str:
    """An unsigned command is not executed, unless the link is trusted."""
    with _key_set(peer):
        _need_distrust(peer)
    return "refused"


@check("signing.refuses_the_wrong_key", needs=[ALTER])
def refuses_wrong_key(peer: Peer) -> str:
    """A command signed with another key is not executed, unless the link is trusted."""
    with _key_set(peer) as stamp:
        _need_distrust(peer)
        _sign_with(peer, FORGER, OTHER_KEY, stamp + 9000)
        obeyed = _obeyed(peer, peer.pack(peer.command_long(REQUEST, VERSION), FORGER))
    holds(not obeyed, "expected no answer to a wrong key, saw a COMMAND_ACK")
    return "refused"


@check("signing.refuses_a_replay", needs=[ALTER])
def refuses_replay(peer: Peer) -> str:
    """The same signed frame again is not executed, unless the link is trusted."""
    with _key_set(peer):
        _need_distrust(peer)
        data = peer.pack(peer.command_long(REQUEST, VERSION), SIGNER)
        holds(_obeyed(peer, data), "the first was not executed")
        obeyed = _obeyed(peer, data)
    holds(not obeyed, "expected no answer to a replay, saw a COMMAND_ACK")
    return "refused"


@check("signing.can_be_turned_off", needs=[ALTER])
def turned_off(peer: Peer) -> str:
    """An empty key ends signing."""
    with _key_set(peer):
        pass
    mark = peer.wait(3.0)
    left = _signed(peer.heard[mark:])
    equal([e.kind for e in left], [], "signed frames")
    equal(result_name(peer.command(REQUEST, VERSION)), "ACCEPTED", "an unsigned command")
    return "off"
