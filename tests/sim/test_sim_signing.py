"""MAVLink 2 signing of finished frames, compared with pymavlink, and of a vehicle with a key."""

from typing import Any

import pytest
from fuzz_bench import Bench
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.fleet import Fleet
from sim_vehicle.wire.signing import Signing

KEY = bytes(range(32))
MINUTE = 60 * 100_000  # ticks of a time stamp
START = 500_000_000_000  # a time stamp of some day in 2020


def station(key: bytes | None = KEY, *, timestamp: int = START, link_id: int = 3) -> mavlink.MAVLink:
    codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    codec.robust_parsing = True
    codec.signing.timestamp = timestamp
    codec.signing.link_id = link_id
    if key is not None:
        codec.signing.secret_key = key
        codec.signing.sign_outgoing = True
    return codec


def keyed() -> Signing:
    signing = Signing()
    signing.set_key(KEY, START)
    return signing


def attitude(time_ms: int = 7) -> mavlink.MAVLink_attitude_message:
    return mavlink.MAVLink_attitude_message(time_ms, 0.1, -0.2, 0.3, 0, 0, 0)


def packed(message: mavlink.MAVLink_message, codec: mavlink.MAVLink | None = None, **kwargs: bool) -> bytes:
    return bytes(message.pack(codec or station(None), **kwargs))


@given(text=st.binary(min_size=1, max_size=50), severity=st.integers(0, 7), seq=st.integers(0, 255))
def test_pymavlink_accepts_signed_frames(text: bytes, severity: int, seq: int) -> None:
    codec = station(None)
    codec.seq = seq
    message = mavlink.MAVLink_statustext_message(severity, text)
    signed = keyed().sign(packed(message, codec), 9)
    receiver = station()
    (parsed,) = receiver.parse_buffer(signed)
    assert parsed.get_type() == "STATUSTEXT"
    assert parsed.get_signed()
    assert parsed.get_link_id() == 9
    assert parsed.severity == severity
    assert receiver.signing.goodsig_count == 1


def test_time_stamps_begin_a_minute_after_the_key_and_never_repeat() -> None:
    """The first time stamp of ArduCopter 4.6.2 was 6,000,001 ticks after that of the key."""
    signing = keyed()
    stamps = [int.from_bytes(signing.sign(packed(attitude()), 0)[-12:-6], "little") for _ in range(3)]
    assert stamps == [START + MINUTE + 1, START + MINUTE + 2, START + MINUTE + 3]


def test_boot_text_and_mavlink1_are_not_signed() -> None:
    signing = keyed()
    old = packed(attitude(), force_mavlink1=True)
    for data in (b"\n\nInit ArduCopter", b"", old):
        assert signing.sign(data, 0) == data


def test_each_stream_refuses_its_older_frames() -> None:
    signing = keyed()
    early = packed(attitude(), station(timestamp=START + 100))
    late = packed(attitude(), station(timestamp=START + 200))
    elsewhere = packed(attitude(), station(timestamp=START + 150, link_id=4))
    assert signing.accepts(late)
    assert not signing.accepts(early)
    assert signing.accepts(elsewhere)


def test_a_new_stream_may_not_be_older_than_the_key() -> None:
    """ArduCopter 4.6.2 refused a stamp 1 s before that of the key, and accepted 1 s to 70 s after it."""
    assert not keyed().accepts(packed(attitude(), station(timestamp=START - 1)))
    for later in (0, MINUTE // 60, MINUTE // 3, MINUTE, 2 * MINUTE):
        assert keyed().accepts(packed(attitude(), station(timestamp=START + later)))


def test_a_new_stream_may_be_a_minute_behind_the_latest_message() -> None:
    for behind, accepted in ((MINUTE, True), (MINUTE + 1, False)):
        signing = keyed()
        assert signing.accepts(packed(attitude(), station(timestamp=START + 10 * MINUTE)))
        late = station(timestamp=START + 10 * MINUTE - behind, link_id=4)
        assert signing.accepts(packed(attitude(), late)) is accepted


def test_a_forged_frame_does_not_move_the_clock_of_its_stream() -> None:
    signing = keyed()
    forged = bytearray(packed(attitude(), station(timestamp=START + 10**9)))
    forged[-1] ^= 1
    assert not signing.accepts(bytes(forged))
    assert signing.accepts(packed(attitude(), station()))


@given(st.integers(0, 10_000), st.integers(1, 255))
def test_a_frame_with_a_changed_byte_is_refused(place: int, change: int) -> None:
    frame = bytearray(packed(attitude(), station()))
    place %= len(frame) - 1
    frame[1 + place] ^= change
    assert not keyed().accepts(bytes(frame))


def test_an_unsigned_frame_is_refused_except_radio_status() -> None:
    signing = keyed()
    assert not signing.accepts(packed(attitude()))
    assert not signing.accepts(packed(attitude(), force_mavlink1=True))
    report = mavlink.MAVLink_radio_status_message(80, 80, 100, 40, 40, 0, 0)
    assert signing.accepts(packed(report))
    assert signing.accepts(packed(report, force_mavlink1=True))
    assert signing.accepts(packed(report, station(bytes(31) + b"x")))  # even with a wrong signature


def test_a_reboot_keeps_the_key_and_forgets_the_streams() -> None:
    signing = keyed()
    frame = packed(attitude(), station())
    assert signing.accepts(frame)
    signing.reboot()
    assert signing.active
    assert signing.accepts(frame)


def test_streams_above_the_limit_are_refused() -> None:
    signing = keyed()
    accepted = [signing.accepts(packed(attitude(), station(link_id=i))) for i in range(20)]
    assert accepted == [True] * 16 + [False] * 4


# -- SETUP_SIGNING to a vehicle ---------------------------------------------------------------------------


def answers(bench: Bench) -> bool:
    """Return True if vehicle 1 answers a request."""
    request = mavlink.MAVLink_param_request_list_message(1, 1)
    return any(m.get_type() == "PARAM_VALUE" for m in [*bench.send(request), *bench.wait(0.1)])


def random_setup(target: int) -> Any:
    return mavlink.MAVLink_setup_signing_message(target, 255, list(KEY), 7)


@pytest.mark.parametrize(("target", "hears"), [(1, False), (0, False), (2, True), (9, True)])
def test_setup_signing_to_an_ardupilot_leaves_it_deaf_to_unsigned_messages(target: int, hears: bool) -> None:
    bench = Bench("ardupilot", "copter")
    bench.send(random_setup(target))
    assert answers(bench) is hears


def test_a_px4_ignores_setup_signing() -> None:
    bench = Bench("px4", "copter")
    bench.send(random_setup(1))
    assert answers(bench)


def test_an_armed_ardupilot_refuses_a_key_and_hears_on() -> None:
    bench = Bench("ardupilot", "copter")
    bench.fly()
    replies = bench.send(random_setup(1))
    assert [m.severity for m in replies if m.get_type() == "STATUSTEXT"] == [mavlink.MAV_SEVERITY_WARNING]
    assert answers(bench)


def test_only_the_key_ends_the_signing_and_a_reboot_does_not() -> None:
    bench = Bench("ardupilot", "copter")
    bench.sign(1)
    assert answers(bench)
    bench.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
    bench.wait(3.0)
    assert answers(bench)
    bench.set_signatures(on=False)
    assert not answers(bench)
    bench.set_signatures(on=True)
    bench.send(mavlink.MAVLink_setup_signing_message(1, 1, [0] * 32, 0))
    bench.set_signatures(on=False)
    assert answers(bench)


def test_a_trusted_link_accepts_unsigned_messages_and_answers_with_signatures() -> None:
    """SERIAL0 of ArduCopter 4.6.2 answered unsigned and wrongly signed requests too."""
    bench = Bench("ardupilot", "copter")
    bench.fleet = Fleet(bench.fleet.scenario, ready_s=0.0, trusted_links=(0,))
    bench.send(random_setup(1))
    assert answers(bench)
    assert bench.raw[-1][2] & 1  # the bit of a signed frame
