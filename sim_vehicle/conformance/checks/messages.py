"""Messages on request, intervals and data streams."""

from collections.abc import Iterable
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance import flying
from sim_vehicle.conformance.assertions import equal, holds, near, refused, within
from sim_vehicle.conformance.outcomes import ACCEPTED, CheckFailed, Skip
from sim_vehicle.conformance.registry import check, checks, row
from sim_vehicle.conformance.vehicle import VehicleUnderTest
from sim_vehicle.definitions import id_of
from sim_vehicle.station.frames import ReceivedFrame

NOT_A_MESSAGE = 16_777_000  # an unused message id
REQUESTED = (
    "SYS_STATUS", "SYSTEM_TIME", "GPS_RAW_INT", "ATTITUDE", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT",
    "VFR_HUD", "BATTERY_STATUS", "EXTENDED_SYS_STATE", "HOME_POSITION",
)  # fmt: skip
REQUESTED_OF_ARDUPILOT = (
    "AHRS", "AHRS2", "HWSTATUS", "MEMINFO", "MISSION_ITEM_REACHED", "POWER_STATUS", "VIBRATION",
)  # fmt: skip
WITHOUT_DATA = "CAMERA_FEEDBACK"  # needs a camera
REQUEST, SET_INTERVAL = mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL


def _require(vehicle: VehicleUnderTest, kind: str) -> None:
    """Request a message; raise CheckFailed if the vehicle refuses."""
    try:
        vehicle.request(kind)
    except Skip as refusal:
        raise CheckFailed(f"expected {kind} on request: {refusal}") from refusal


def _sends_on_request(vehicle: VehicleUnderTest, kind: str) -> None:
    flying.wait_ready(vehicle)
    # The known autopilots send all messages of `REQUESTED`, but HOME_POSITION only with a home.
    if vehicle.dialect.is_known and kind != "HOME_POSITION":
        _require(vehicle, kind)
    else:
        vehicle.request(kind)


checks(
    "messages.request",
    _sends_on_request,
    *[
        row(
            kind.lower(),
            f"The vehicle sends {kind} on request; PX4 denies a repeated request without news.",
            kind,
        )
        for kind in REQUESTED
    ],
    source="PX4 mavlink_receiver.cpp, handle_request_message_command: DENIED without news",
)


@check(
    "messages.request",
    source="PX4 mavlink_mission.cpp, send_mission_current: no stream, so a request is DENIED",
)
def mission_current(vehicle: VehicleUnderTest) -> None:
    """ArduPilot sends MISSION_CURRENT on request; PX4 answers DENIED and sends it once a second."""
    expected = vehicle.known(ardupilot=ACCEPTED, px4="DENIED")
    mark = vehicle.mark()
    equal(vehicle.command(REQUEST, id_of("MISSION_CURRENT")), expected, "REQUEST_MESSAGE")
    vehicle.expect("MISSION_CURRENT", within_s=3.0, mark=mark)


@check("messages.request", dialects=("ardupilot",))
def of_ardupilot(vehicle: VehicleUnderTest) -> None:
    """ArduPilot sends, on request, further messages that ground stations show."""
    for kind in REQUESTED_OF_ARDUPILOT:
        _require(vehicle, kind)


@check("messages.request", dialects=("ardupilot",))
def without_data(vehicle: VehicleUnderTest) -> None:
    """ArduPilot accepts a request for a message that it knows and has no data for, and sends nothing."""
    equal(vehicle.command(REQUEST, id_of(WITHOUT_DATA)), ACCEPTED, f"request for {WITHOUT_DATA}")
    vehicle.expect_none(WITHOUT_DATA, during_s=1.0)


@check("messages.request")
def sends_one(vehicle: VehicleUnderTest) -> None:
    """The vehicle answers one request with one message, without a stream."""
    vehicle.set_interval("BATTERY_STATUS", -1)
    mark = vehicle.mark()
    vehicle.request("BATTERY_STATUS")
    vehicle.wait(2.0)
    equal(len(vehicle.since(mark, "BATTERY_STATUS")), 1, "BATTERY_STATUS after one request")
    vehicle.set_interval("BATTERY_STATUS", 0)


def _is_refused(vehicle: VehicleUnderTest, command: int, *params: float) -> str:
    return refused(vehicle.command(command, *params))


checks(
    "messages", _is_refused,
    row("request.unknown_is_refused", "A request for an unknown message is refused.", REQUEST, NOT_A_MESSAGE),
    row("interval.unknown_is_refused", "An interval for an unknown message is refused.",
        SET_INTERVAL, NOT_A_MESSAGE, 1e6),
)  # fmt: skip


def _rate_hz(vehicle: VehicleUnderTest, kind: str, seconds: float) -> float:
    return len(vehicle.listen(kind, seconds)) / seconds


def _requested_rate_hz(vehicle: VehicleUnderTest, kind: str, rate_hz: float, seconds: float) -> float:
    with vehicle.streaming({kind: rate_hz}):
        vehicle.wait(1.0)
        return _rate_hz(vehicle, kind, seconds)


def _has_rate(vehicle: VehicleUnderTest, rate_hz: float, seconds: float) -> str:
    seen_hz = _requested_rate_hz(vehicle, "ATTITUDE", rate_hz, seconds)
    return f"{near(seen_hz, rate_hz, max(0.2 * rate_hz, 1 / seconds), 'messages a second'):.2f} Hz"


checks(
    "messages.interval",
    _has_rate,
    *[
        row(f"{hz:g}_hz", f"SET_MESSAGE_INTERVAL for {hz:g} Hz gives that rate within 20 %.", hz, seconds)
        for hz, seconds in ((0.5, 10.0), (1.0, 8.0), (4.0, 5.0), (10.0, 4.0))
    ],
    source="AUTOPILOTS 1.1",
)


@check("messages.interval")
def stops(vehicle: VehicleUnderTest) -> None:
    """An interval of -1 stops the stream."""
    with vehicle.streaming({"ATTITUDE": 5.0}):
        vehicle.expect("ATTITUDE")
        equal(vehicle.set_interval("ATTITUDE", -1), ACCEPTED, "stopping")
        vehicle.wait(0.5)
        vehicle.expect_none("ATTITUDE", during_s=2.0)


@check("messages.interval")
def default(vehicle: VehicleUnderTest) -> str:
    """An interval of 0 restores the default rate."""
    streams_unrequested = vehicle.known(ardupilot=False, px4=True)
    default_hz = _rate_hz(vehicle, "ATTITUDE", 3.0)
    other_hz = 10.0 if default_hz < 5.0 else 2.0
    seen_hz = _requested_rate_hz(vehicle, "ATTITUDE", other_hz, 3.0)
    near(seen_hz, other_hz, max(0.3 * other_hz, 0.7), "messages a second at the requested rate")
    vehicle.wait(0.5)
    after_hz = _rate_hz(vehicle, "ATTITUDE", 3.0)
    near(after_hz, default_hz, max(0.3 * default_hz, 0.7), "messages a second afterwards")
    holds(after_hz > 0 or not streams_unrequested, "expected the default stream, saw none")
    return f"{default_hz:.1f} Hz, {seen_hz:.1f} Hz, {after_hz:.1f} Hz"


def _reported_interval_us(vehicle: VehicleUnderTest, kind: str) -> int:
    """Return the answer to GET_MESSAGE_INTERVAL; raise Skip if the vehicle refuses."""
    mark = vehicle.mark()
    result = vehicle.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, id_of(kind))
    if result != ACCEPTED:
        raise Skip(f"the vehicle answers GET_MESSAGE_INTERVAL with {result}")
    answer = vehicle.expect("MESSAGE_INTERVAL", lambda m: m.message_id == id_of(kind), mark=mark)
    return int(answer.interval_us)


@check("messages.interval")
def is_reported(vehicle: VehicleUnderTest) -> str:
    """GET_MESSAGE_INTERVAL reports the requested interval."""
    with vehicle.streaming({"VFR_HUD": 4.0}):
        seen_us = _reported_interval_us(vehicle, "VFR_HUD")
        return f"{near(seen_us, 250_000, 25_000, 'interval_us')} us"


@check("messages.interval")
def reported_when_stopped(vehicle: VehicleUnderTest) -> str:
    """GET_MESSAGE_INTERVAL of a stopped message reports -1 or 0."""
    with vehicle.streaming({"VFR_HUD": 4.0}):
        vehicle.set_interval("VFR_HUD", -1)
        return str(within(_reported_interval_us(vehicle, "VFR_HUD"), -1, 0, "interval_us"))


@check("messages.interval")
def other_rates_are_kept(vehicle: VehicleUnderTest) -> str:
    """Two messages with different intervals keep their rates."""
    with vehicle.streaming({"ATTITUDE": 2.0, "VFR_HUD": 5.0}):
        vehicle.wait(1.0)
        kinds = [frame.kind for frame in vehicle.wait(5.0)]
    attitude_hz, hud_hz = (kinds.count(kind) / 5 for kind in ("ATTITUDE", "VFR_HUD"))
    near(attitude_hz, 2.0, 0.5, "ATTITUDE a second")
    near(hud_hz, 5.0, 1.0, "VFR_HUD a second")
    return f"{attitude_hz:.1f} and {hud_hz:.1f} Hz"


@check("messages.interval")
def by_command_int(vehicle: VehicleUnderTest) -> str:
    """SET_MESSAGE_INTERVAL works as COMMAND_INT."""
    try:
        result = vehicle.result(vehicle.command_int(SET_INTERVAL, id_of("ATTITUDE"), 2e5))
        equal(result, ACCEPTED, "COMMAND_INT")
        vehicle.expect("ATTITUDE")
    finally:
        with vehicle.extra_time():
            vehicle.set_interval("ATTITUDE", 0)
    return result


_ardupilot_check = partial(check, "messages.streams", dialects=("ardupilot",))


def _request_streams(vehicle: VehicleUnderTest, stream: int, rate_hz: int) -> None:
    """Send REQUEST_DATA_STREAM; a rate of 0 stops the stream."""
    start = int(rate_hz > 0)
    vehicle.send(mavlink.MAVLink_request_data_stream_message(*vehicle.target, stream, rate_hz, start))


def _count_kinds(frames: Iterable[ReceivedFrame], *expected: str) -> str:
    """Return the number of kinds; raise CheckFailed if an expected kind is missing."""
    seen = {entry.kind for entry in frames}
    equal(sorted(set(expected) - seen), [], "missing messages")
    return f"{len(seen)} kinds of message"


@_ardupilot_check(source="AUTOPILOTS 1.1: REQUEST_DATA_STREAM works")
def position(vehicle: VehicleUnderTest) -> str:
    """REQUEST_DATA_STREAM of the position brings GLOBAL_POSITION_INT at the rate, within 25 %."""
    _request_streams(vehicle, mavlink.MAV_DATA_STREAM_POSITION, 4)
    vehicle.wait(1.0)
    seen_hz = _rate_hz(vehicle, "GLOBAL_POSITION_INT", 4.0)
    _request_streams(vehicle, mavlink.MAV_DATA_STREAM_POSITION, 0)
    return f"{near(seen_hz, 4.0, 1.0, 'GLOBAL_POSITION_INT a second'):.1f} Hz"


@_ardupilot_check(source="AUTOPILOTS 1.1: id 0, 4 Hz")
def all_(vehicle: VehicleUnderTest) -> str:
    """Stream id 0 at 4 Hz brings position, attitude, SYS_STATUS, VFR_HUD and GPS_RAW_INT."""
    _request_streams(vehicle, mavlink.MAV_DATA_STREAM_ALL, 4)
    frames = vehicle.wait(3.0)
    _request_streams(vehicle, mavlink.MAV_DATA_STREAM_ALL, 0)
    return _count_kinds(frames, "GLOBAL_POSITION_INT", "ATTITUDE", "SYS_STATUS", "VFR_HUD", "GPS_RAW_INT")


@_ardupilot_check()
def stop(vehicle: VehicleUnderTest) -> None:
    """REQUEST_DATA_STREAM with start_stop 0 ends a stream."""
    _request_streams(vehicle, mavlink.MAV_DATA_STREAM_EXTRA1, 5)
    vehicle.expect("ATTITUDE")
    _request_streams(vehicle, mavlink.MAV_DATA_STREAM_EXTRA1, 0)
    vehicle.wait(0.5)
    vehicle.expect_none("ATTITUDE", during_s=2.0)


@check("messages.streams", dialects=("px4",), source="AUTOPILOTS 2: streams flow without a request")
def sent_without_request(vehicle: VehicleUnderTest) -> str:
    """PX4 streams attitude, position and SYS_STATUS without a request."""
    return _count_kinds(vehicle.wait(4.0), "ATTITUDE", "GLOBAL_POSITION_INT", "SYS_STATUS")
