"""The vehicle under test: its state, its commands, and the changes to undo."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.assertions import equal
from sim_vehicle.conformance.dialects import GENERIC, Dialect, VehicleIdentity, dialect_of
from sim_vehicle.conformance.outcomes import ACCEPTED, CheckFailed, Skip, command_name
from sim_vehicle.conformance.traffic import ATTEMPTS, Traffic, Wire, WireError, is_autopilot
from sim_vehicle.definitions import id_of
from sim_vehicle.station.exchanges import Command
from sim_vehicle.station.frames import STATION, ReceivedFrame, Source
from sim_vehicle.station.messages import command_int, command_long

NEWS_S = 3.0  # longest wait for news of a message that was sent before
CONNECT_S = 30.0  # longest wait for the first heartbeat
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


class VehicleUnderTest(Traffic):
    """One vehicle: identity, state, commands, and changes that are undone afterwards."""

    def __init__(self, wire: Wire) -> None:
        super().__init__(wire)
        self.dialect: Dialect = GENERIC
        # changed part of the vehicle -> function that restores the part
        self.pending_restores: dict[str, Callable[[], None]] = {}
        self.catalogue: dict[str, Any] = {}  # the parameter list; empty before `fetch_all`

    def connect(self, sysid: int | None = None) -> VehicleIdentity:
        """Wait for the autopilot `sysid`, or for any autopilot; return its identity. Raises WireError."""
        end_s = self.now + CONNECT_S
        seen: set[int] = set()
        while self.now < end_s:
            self._pump(0.2)
            for entry in self.received:
                if entry.kind == "HEARTBEAT" and is_autopilot(entry.message):
                    seen.add(entry.sysid)
                    if sysid in (None, entry.sysid):
                        return self._connected(entry)
        others = f"; system ids of other autopilots: {sorted(seen)}" if seen else ""
        wanted = "an autopilot" if sysid is None else f"system {sysid}"
        raise WireError(
            f"no heartbeat of {wanted} within {CONNECT_S:g} s{others}; check the URL [no-heartbeat]"
        )

    def _connected(self, entry: ReceivedFrame) -> VehicleIdentity:
        beat = entry.message
        self.identity = VehicleIdentity(entry.sysid, entry.component, beat.autopilot, beat.type)
        self.dialect = dialect_of(beat.autopilot, beat.type)
        self._wire.follow(entry.sysid)
        self.received = [e for e in self.received if e.sysid == entry.sysid]
        self.last = {}
        for received in self.received:
            self._keep_latest(received)
        for request in (
            self.version_request(),
            self.command_long(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1),
        ):
            try:
                version = self.ask(request, "AUTOPILOT_VERSION")
            except CheckFailed:
                continue
            self.identity = replace(
                self.identity,
                capabilities=version.capabilities,
                software=version.flight_sw_version,
                uid2=bytes(version.uid2),
            )
            break
        return self.identity

    @property
    def heartbeat(self) -> Any:
        """Return the latest HEARTBEAT of the autopilot."""
        return self.last["HEARTBEAT"]

    @property
    def armed(self) -> bool:
        return bool(self.heartbeat.base_mode & ARMED)

    @property
    def mode(self) -> int:
        return int(self.heartbeat.custom_mode)

    def known(self, **behaviour: Any) -> Any:
        """Return the behaviour of this autopilot, by its dialect's name; raise Skip if it is unknown."""
        if self.dialect.name not in behaviour:
            raise Skip("the specification leaves this open, and the behaviour of this autopilot is unknown")
        return behaviour[self.dialect.name]

    @contextmanager
    def restoring(self, part: str, undo: Callable[[], None]) -> Iterator[None]:
        """Undo a change of the vehicle at the end; `restore_all` repeats a failed `undo`."""
        nested = part in self.pending_restores
        self.pending_restores.setdefault(part, undo)
        try:
            yield
        finally:
            with self.extra_time():
                undo()
            if not nested:
                del self.pending_restores[part]

    def restore_all(self) -> list[str]:
        """Undo the changes of `pending_restores`, latest first; return a text for each failure."""
        failures = []
        for part, undo in reversed(list(self.pending_restores.items())):
            try:
                undo()
            except (CheckFailed, Skip) as error:
                failures.append(f"{part} could not be restored: {error} [not-restored]")
            else:
                del self.pending_restores[part]
        return failures

    # -- commands ----------------------------------------------------------------------------------------

    def command_long(self, command: int, *params: float, confirmation: int = 0, to: Any = None) -> Any:
        return command_long(to or self.target, command, *params, confirmation=confirmation)

    def version_request(self, **fields: Any) -> Any:
        """Return a request for AUTOPILOT_VERSION, which has no effect and is answered by every vehicle."""
        version = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        return self.command_long(mavlink.MAV_CMD_REQUEST_MESSAGE, version, **fields)

    def command_int(self, command: int, *params: float, to: Any = None, **place: Any) -> Any:
        """Return COMMAND_INT; `place`: frame, x, y, z."""
        return command_int(to or self.target, command, *params, **place)

    def result(self, message: Any, *, source: Source = STATION, attempts: int = ATTEMPTS) -> str:
        """Send a command up to `attempts` times; return the name of its final MAV_RESULT.

        Raises CheckFailed without a COMMAND_ACK.
        """
        outcome = self.complete(
            Command(lambda m: self.send(m, source), message, sysid=source[0], attempts=attempts)
        )
        if outcome.message is None:
            name = command_name(message.command)
            raise CheckFailed(f"expected a COMMAND_ACK for {name}, saw {outcome.text}")
        return outcome.text

    def command(self, command: int, *params: float) -> str:
        """Send COMMAND_LONG; return the name of its final MAV_RESULT."""
        return self.result(self.command_long(command, *params))

    def expect_accepted(self, command: int, *params: float) -> None:
        """Send COMMAND_LONG; raise CheckFailed unless the vehicle accepts the command."""
        equal(self.command(command, *params), ACCEPTED, command_name(command))

    def expect_answer(self) -> None:
        """Raise CheckFailed unless the vehicle accepts a command without an effect."""
        equal(self.result(self.version_request()), ACCEPTED, "a command afterwards")

    # -- messages on request -----------------------------------------------------------------------------

    def request(self, kind: str, *params: float) -> Any:
        """Return a message requested by REQUEST_MESSAGE; raise Skip if the vehicle refuses the request.

        PX4 answers DENIED if it has sent the message and has no news since (mavlink_receiver.cpp,
        handle_request_message_command). Then the request is repeated, and a message of the stream counts.
        """
        mark, end_s = self.mark(), self.now + NEWS_S
        while True:
            result = self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, id_of(kind), *params)
            if result == ACCEPTED:
                return self.expect(kind, mark=mark, description=f"{kind} after its request was accepted")
            denied = result == "DENIED"
            message = self.wait_for(kind, within_s=NEWS_S / 10, mark=mark) if denied else None
            if message is not None:
                return message
            if not denied or self.now >= end_s:
                raise Skip(f"the vehicle does not send {kind} on request ({result})")

    def set_interval(self, kind: str, rate_hz: float) -> str:
        """Send SET_MESSAGE_INTERVAL (-1: stop, 0: default rate); return the name of the MAV_RESULT."""
        interval_us = rate_hz if rate_hz <= 0 else 1e6 / rate_hz
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, id_of(kind), interval_us)

    @contextmanager
    def streaming(self, rates_hz: Mapping[str, float]) -> Iterator[None]:
        """Stream messages at these rates, then restore the default rates; raise Skip if one is refused."""
        try:
            for kind, rate_hz in rates_hz.items():
                result = self.set_interval(kind, rate_hz)
                if result != ACCEPTED:
                    raise Skip(f"the vehicle does not stream {kind} ({result})")
            yield
        finally:
            with self.extra_time():
                for kind in rates_hz:
                    self.set_interval(kind, 0)

    def sample(self, rates_hz: Mapping[str, float], seconds: float) -> dict[str, list[Any]]:
        """Return the messages of these streams during `seconds`; raise CheckFailed if a stream is empty."""
        with self.streaming(rates_hz):
            frames = self.wait(seconds)
        found = {kind: [f.message for f in frames if f.kind == kind] for kind in rates_hz}
        for kind, messages in found.items():
            if not messages:
                raise CheckFailed(f"expected {kind} at {rates_hz[kind]:g} Hz, saw none in {seconds:g} s")
        return found
