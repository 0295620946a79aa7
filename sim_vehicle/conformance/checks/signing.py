"""MAVLink 2 signing without a key, and the set-up, use and removal of a key."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import equal, holds
from sim_vehicle.conformance.guard import ALTER
from sim_vehicle.conformance.outcomes import ACCEPTED, CheckFailed, Skip, result_name
from sim_vehicle.conformance.registry import check
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.definitions import MAVLINK2
from sim_vehicle.station.frames import STATION, ReceivedFrame

SIGNED = 0x01  # MAVLink 2 incompatibility flag of a signed frame
KEY = hashlib.sha256(b"sim_vehicle conformance").digest()
OTHER_KEY = hashlib.sha256(b"another key").digest()
Y2015_US = 1_420_070_400_000_000  # Unix time of 2015-01-01 [us]
STAMP = 50_000_000_000_000  # time stamp in 2030 [10 us since 2015]
SIGNER, FORGER, PLAIN = (253, 190), (252, 190), (251, 190)  # further stations: (system id, component id)
KEY_REMOVAL_ATTEMPTS = 5
_check = partial(check, "signing", needs=[ALTER])


def _sign_with(vehicle: VehicleUnderTest, source: tuple[int, int], key: bytes, stamp: int) -> None:
    """Sign all later frames of a station of the suite."""
    signing = vehicle.sender.codec(source).signing
    signing.secret_key, signing.link_id, signing.timestamp, signing.sign_outgoing = key, 3, stamp, True


def _signed(entries: list[ReceivedFrame]) -> list[ReceivedFrame]:
    return [e for e in entries if e.raw[0] == MAVLINK2 and e.raw[2] & SIGNED]


@contextmanager
def _signing_key(vehicle: VehicleUnderTest) -> Iterator[int]:
    """Set a key on the vehicle and yield the initial time stamp; raise Skip if the vehicle does not sign."""
    unix_us = vehicle.request("SYSTEM_TIME").time_unix_usec
    stamp = (unix_us - Y2015_US) // 10 + 100 if unix_us > Y2015_US else STAMP + round(vehicle.now * 1e5)
    _sign_with(vehicle, SIGNER, KEY, stamp + 1000)
    with vehicle.restoring("signing (off before the check)", lambda: _remove_key(vehicle)):
        vehicle.send(mavlink.MAVLink_setup_signing_message(*vehicle.target, KEY, stamp))
        if not _signed(vehicle.wait(3.0)):
            raise Skip("the vehicle does not sign after SETUP_SIGNING")
        yield stamp


def _remove_key(vehicle: VehicleUnderTest) -> None:
    """Remove the key and wait for unsigned frames, the only confirmation."""
    for _ in range(KEY_REMOVAL_ATTEMPTS):
        for source in (SIGNER, STATION):
            vehicle.send(mavlink.MAVLink_setup_signing_message(*vehicle.target, bytes(32), 0), source)
        vehicle.wait(1.0)
        frames = vehicle.wait(1.5)
        if frames and not _signed(frames):
            return
    raise CheckFailed("expected unsigned frames after the removal of the key, saw signed frames or none")


@check("signing")
def without_a_key(vehicle: VehicleUnderTest) -> None:
    """A vehicle without a key accepts signed frames."""
    _sign_with(vehicle, FORGER, OTHER_KEY, STAMP)
    message = vehicle.version_request()
    ack = vehicle.ask(message, "COMMAND_ACK", lambda m: m.command == message.command, source=FORGER)
    equal(result_name(ack.result), ACCEPTED, "a signed command")


@_check()
def signs_what_it_sends(vehicle: VehicleUnderTest) -> str:
    """After the set-up of a key the vehicle signs every frame correctly."""
    with _signing_key(vehicle):
        frames = vehicle.wait(3.0)
        signed = _signed(frames)
        equal(len(signed), len(frames), "signed frames")
        wrong = {e.kind for e in signed if e.raw[-6:] != hashlib.sha256(KEY + e.raw[:-6]).digest()[:6]}
        equal(sorted(wrong), [], "wrong signatures")
    return f"{len(signed)} frames"


@_check()
def stamps_go_up(vehicle: VehicleUnderTest) -> str:
    """The time stamps of signatures increase."""
    with _signing_key(vehicle):
        stamps = [int.from_bytes(e.raw[-12:-6], "little") for e in _signed(vehicle.wait(3.0))]
    holds(all(b > a for a, b in pairwise(stamps)), "a time stamp did not increase")
    return f"{len(stamps)} stamps"


@_check()
def takes_the_right_key(vehicle: VehicleUnderTest) -> None:
    """A command signed with the right key is executed."""
    with _signing_key(vehicle):
        ack = vehicle.ask(vehicle.version_request(), "COMMAND_ACK", source=SIGNER)
    equal(result_name(ack.result), ACCEPTED, "a signed command")


def _executed(vehicle: VehicleUnderTest, data: bytes) -> bool:
    vehicle.send_raw(data)
    return vehicle.wait_for("COMMAND_ACK", within_s=1.5) is not None


def _require_untrusted_link(vehicle: VehicleUnderTest) -> None:
    """Raise Skip if the vehicle trusts the link and therefore accepts unsigned frames."""
    if _executed(vehicle, vehicle.sender.pack(vehicle.version_request(), PLAIN)):
        raise Skip("the vehicle trusts this link and accepts unsigned frames")
    # An answer shows that the link works, so the unsigned request was probably refused, not lost.
    vehicle.ask(vehicle.version_request(), "COMMAND_ACK", source=SIGNER)


@_check()
def refuses_unsigned(vehicle: VehicleUnderTest) -> None:
    """An unsigned command is refused, unless the link is trusted."""
    with _signing_key(vehicle):
        _require_untrusted_link(vehicle)


@_check()
def refuses_the_wrong_key(vehicle: VehicleUnderTest) -> None:
    """A command signed with a wrong key is refused, unless the link is trusted."""
    with _signing_key(vehicle) as stamp:
        _require_untrusted_link(vehicle)
        _sign_with(vehicle, FORGER, OTHER_KEY, stamp + 9000)
        executed = _executed(vehicle, vehicle.sender.pack(vehicle.version_request(), FORGER))
    holds(not executed, "expected no answer to a wrong key, saw a COMMAND_ACK")


@_check()
def refuses_a_replay(vehicle: VehicleUnderTest) -> None:
    """A repeated signed frame is refused, unless the link is trusted."""
    with _signing_key(vehicle):
        _require_untrusted_link(vehicle)
        data = vehicle.sender.pack(vehicle.version_request(), SIGNER)
        holds(_executed(vehicle, data), "the first command was not executed")
        executed = _executed(vehicle, data)
    holds(not executed, "expected no answer to a replay, saw a COMMAND_ACK")


@_check()
def can_be_turned_off(vehicle: VehicleUnderTest) -> None:
    """A key of zeros ends signing."""
    with _signing_key(vehicle):
        pass
    equal([e.kind for e in _signed(vehicle.wait(3.0))], [], "signed frames")
    vehicle.expect_answer()
