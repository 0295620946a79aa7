"""The ground station the checks speak through: bytes of a `Wire` in and out, time only from it."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_vehicle.conformance.dialects import GENERIC, Dialect, dialect_of
from sim_vehicle.conformance.facts import Facts, Heard
from sim_vehicle.conformance.guard import Forbidden, is_for, only_asks, refusal
from sim_vehicle.conformance.outgoing import LONGEST_FRAME, sent_in
from sim_vehicle.conformance.wire import Wire, WireError
from sim_vehicle.conformance.words import CheckFailed, Skip, command_name, equal, id_of, result_name

Where = Callable[[Any], bool]
HEARTBEAT_S = 1.0
REPLY_S = 1.5  # an autopilot that is not busy answers within a fraction of that
IN_PROGRESS_S = 60.0
MEET_S = 30.0
TIDY_S = 60.0  # for putting something back, whatever time the check has left
SYSTEMS = 250  # a vehicle's id is at most that
EPSILON_S = 1e-6  # sums of times need not be equal to the last bit
STATION, SECOND_STATION = (255, 190), (254, 191)
ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def is_autopilot(heartbeat: Any) -> bool:
    """Whether a HEARTBEAT is an autopilot's: a camera on board has the same system id."""
    return bool(heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID)


class Peer:
    """A ground station that talks to one vehicle.

    Every wait lets time pass on the wire; a heartbeat of the station goes out each second. `heard` has what
    came since the check began, `last` the newest of each kind, `texts` every STATUSTEXT of the run. `systems`
    has every system id that was ever heard, the vehicle's or another's, `saved` the MAV_MISSION_TYPE of the
    plans that may be overwritten because there is a copy.
    """

    def __init__(self, wire: Wire, *, permits: Collection[str] = ()) -> None:
        """`permits`: what may be done to the vehicle, see `registry.PERMISSIONS`."""
        self._wire = wire
        self.permits: set[str] = set(permits)
        self.facts = Facts(0, 1, mavlink.MAV_AUTOPILOT_INVALID, 0)
        self.dialect: Dialect = GENERIC
        self.heard: list[Heard] = []
        self.last: dict[str, Heard] = {}
        self.texts: list[tuple[float, int, str]] = []
        self.noise = bytearray()  # bytes since the check began that were no MAVLink
        self.quiet = False  # True: the station's heartbeats stop
        self.deadline_s = math.inf
        self._codecs: dict[tuple[int, int], mavlink.MAVLink] = {}
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._next_heartbeat_s = 0.0
        self.systems: set[int] = set()
        self.saved: set[int] = set()
        self.debts: dict[str, Callable[[], None]] = {}  # what of the vehicle is changed, and what undoes it
        self._said = b""  # the last bytes sent: a frame may go out in pieces
        self.catalogue: dict[str, Any] = {}  # the parameter list, once it has been fetched

    # -- getting to know the vehicle ---------------------------------------------------------------------

    def meet(self, sysid: int | None = None) -> Facts:
        """Wait for an autopilot (the one with `sysid`, or the first heard) and ask who it is."""
        end_s = self.now + MEET_S
        seen: set[int] = set()
        while self.now < end_s:
            self._pump(0.2)
            for entry in self.heard:
                if entry.kind == "HEARTBEAT" and is_autopilot(entry.message):
                    seen.add(entry.sysid)
                    if sysid in (None, entry.sysid):
                        return self._met(entry)
        others = f"; heard system ids {sorted(seen)}" if seen else ""
        wanted = "an autopilot" if sysid is None else f"system {sysid}"
        raise WireError(f"no heartbeat of {wanted} within {MEET_S:g} s{others}; is the URL right?")

    def _met(self, entry: Heard) -> Facts:
        beat = entry.message
        self.facts = Facts(entry.sysid, entry.component, beat.autopilot, beat.type)
        self.dialect = dialect_of(beat.autopilot, beat.type)
        self._wire.follow(entry.sysid)
        self.heard = [e for e in self.heard if e.sysid == entry.sysid]
        self.last = {e.kind: e for e in self.heard}
        for command in (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES):
            params = (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION,) if command == 512 else (1,)
            for _ in range(3):
                self.send(self.command_long(command, *params))
                version = self.maybe("AUTOPILOT_VERSION", within_s=REPLY_S)
                if version is not None:
                    self.facts = Facts(
                        entry.sysid,
                        entry.component,
                        beat.autopilot,
                        beat.type,
                        version.capabilities,
                        version.flight_sw_version,
                        bytes(version.uid2),
                    )
                    return self.facts
        return self.facts

    @property
    def target(self) -> tuple[int, int]:
        return self.facts.sysid, self.facts.component

    @property
    def now(self) -> float:
        return self._wire.now_s()

    @property
    def heartbeat(self) -> Any:
        """The newest HEARTBEAT of the autopilot."""
        return self.last["HEARTBEAT"].message

    @property
    def armed(self) -> bool:
        return bool(self.heartbeat.base_mode & ARMED)

    @property
    def mode(self) -> int:
        return int(self.heartbeat.custom_mode)

    def fresh(self, limit_s: float = math.inf) -> None:
        """A check begins: forget what was heard; it may take `limit_s` [s]."""
        self.deadline_s = math.inf
        self._pump(0.0)
        self.heard.clear()
        self.noise.clear()
        self.quiet = False
        self.deadline_s = self.now + limit_s

    # -- out ---------------------------------------------------------------------------------------------

    def codec(self, source: tuple[int, int] = STATION) -> mavlink.MAVLink:
        """The packer of one of our stations."""
        if source not in self._codecs:
            self._codecs[source] = mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
        return self._codecs[source]

    def pack(self, message: Any, source: tuple[int, int] = STATION) -> bytes:
        codec = self.codec(source)
        data = bytes(message.pack(codec))
        codec.seq = (codec.seq + 1) % 256
        return data

    def send(self, message: Any, source: tuple[int, int] = STATION) -> None:
        """Send a message as one of our stations; `Skip` where that is not allowed."""
        self.send_raw(self.pack(message, source))

    def send_raw(self, data: bytes) -> None:
        """Send bytes, which need be no message: the one way out, where every frame in them is looked at."""
        objection = self.objection(data)
        if objection is not None:
            raise objection
        self._said = (self._said + data)[-LONGEST_FRAME:]
        self._wire.send(data)

    def objection(self, data: bytes) -> Skip | Forbidden | None:
        """Why these bytes may not be sent; None where they may.

        What could change another vehicle than the one that was met is `Forbidden`: no option allows that.
        """
        for sent in sent_in(self._said + data, len(self._said)):
            if not is_for(sent, self.facts.sysid) and not only_asks(sent):
                return Forbidden(f"{sent.kind} is for system {sent.target}, not for {self.facts.sysid}")
            reason = refusal(sent, self.permits, self.saved)
            if reason is not None:
                return Skip(reason)
        return None

    def stranger(self) -> int:
        """A system id that nobody on the link was ever heard to have."""
        for step in range(1, SYSTEMS):
            sysid = (self.facts.sysid + step - 1) % SYSTEMS + 1
            if sysid not in self.systems:
                return sysid
        raise Skip("every system id is taken")

    # -- putting back ------------------------------------------------------------------------------------

    @contextmanager
    def tidying(self) -> Iterator[None]:
        """What is done here has time of its own, so that it is repeated where the link loses it."""
        before_s = self.deadline_s
        self.deadline_s = max(before_s, self.now + TIDY_S)
        try:
            yield
        finally:
            self.deadline_s = before_s

    @contextmanager
    def owing(self, what: str, undo: Callable[[], None]) -> Iterator[None]:
        """Something of the vehicle is changed for a while; what cannot be undone stays a debt, see `pay`."""
        outer = what in self.debts
        self.debts.setdefault(what, undo)
        try:
            yield
        finally:
            with self.tidying():
                undo()
            if not outer:
                del self.debts[what]

    def pay(self) -> list[str]:
        """Undo what is still changed; what could not be undone, in words."""
        trouble = []
        for what, undo in reversed(list(self.debts.items())):
            try:
                undo()
            except (CheckFailed, Skip) as error:
                trouble.append(f"{what} could not be put back: {error}")
            else:
                del self.debts[what]
        return trouble

    # -- in ----------------------------------------------------------------------------------------------

    def _pump(self, timeout_s: float) -> None:
        """Take what has come, waiting at most `timeout_s` [s] for something."""
        if self.now > self.deadline_s:
            raise CheckFailed("not done in time")
        if self.now >= self._next_heartbeat_s - EPSILON_S:
            self._next_heartbeat_s = self.now + HEARTBEAT_S
            if not self.quiet:
                self.send(
                    mavlink.MAVLink_heartbeat_message(
                        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
                    )
                )
        data = self._wire.receive(min(timeout_s, max(0.0, self._next_heartbeat_s - self.now)))
        while data is not None:
            self._take(data)
            data = self._wire.receive(0.0)

    def _take(self, data: bytes) -> None:
        for message in self._parser.parse_buffer(data) or ():
            kind, raw = message.get_type(), bytes(message.get_msgbuf())
            if kind == "BAD_DATA":
                self.noise += raw
                continue
            v2 = raw[0] == 0xFD
            sysid, component, seq = (raw[5], raw[6], raw[4]) if v2 else (raw[3], raw[4], raw[2])
            self.systems.add(sysid)
            if self.facts.sysid not in (0, sysid):
                continue
            entry = Heard(self.now, kind, message, sysid, component, seq, raw)
            self.heard.append(entry)
            if kind == "HEARTBEAT" and not is_autopilot(message):
                continue
            self.last[kind] = entry
            if kind == "STATUSTEXT":
                self.texts.append((self.now, message.severity, message.text))

    def mark(self) -> int:
        """A place in `heard`: what comes from now on lies behind it."""
        return len(self.heard)

    def since(self, mark: int, kind: str | None = None) -> list[Any]:
        """Messages behind a mark, of one kind or all."""
        return [entry.message for entry in self.heard[mark:] if kind in (None, entry.kind)]

    def wait(self, seconds: float) -> int:
        """Let time pass; the mark of its beginning."""
        begin, end_s = self.mark(), self.now + seconds
        while self.now < end_s - EPSILON_S:
            self._pump(end_s - self.now)
        return begin

    def until(self, condition: Callable[[], bool], what: str, within_s: float) -> float:
        """Wait for a condition; how long it took [s]. `what` is said if it does not come true."""
        began_s = self.now
        while not condition():
            if self.now - began_s > within_s:
                raise CheckFailed(f"expected {what} within {within_s:g} s")
            self._pump(0.1)
        return self.now - began_s

    def seek(
        self, kinds: Collection[str], where: Where | None = None, *, within_s: float, mark: int
    ) -> int | None:
        """Wait for a message of one of these kinds behind a mark; its place in `heard`, None without one."""
        end_s = self.now + within_s
        while True:
            for place in range(mark, len(self.heard)):
                entry = self.heard[place]
                if entry.kind in kinds and (where is None or where(entry.message)):
                    return place
            if self.now >= end_s - EPSILON_S:
                return None
            mark = self.mark()
            self._pump(end_s - self.now)

    def maybe(
        self, kind: str, where: Where | None = None, *, within_s: float = REPLY_S, mark: int | None = None
    ) -> Any | None:
        """Wait for a message; None where it does not come. `mark`: look at what has come since, too."""
        place = self.seek((kind,), where, within_s=within_s, mark=self.mark() if mark is None else mark)
        return None if place is None else self.heard[place].message

    def expect(
        self,
        kind: str,
        where: Where | None = None,
        *,
        within_s: float = REPLY_S,
        mark: int | None = None,
        what: str = "",
    ) -> Any:
        """Wait for a message; CheckFailed where it does not come."""
        message = self.maybe(kind, where, within_s=within_s, mark=mark)
        if message is None:
            raise CheckFailed(f"expected {what or kind} within {within_s:g} s, saw none")
        return message

    def none(
        self, kind: str, where: Where | None = None, *, during_s: float, mark: int | None = None
    ) -> None:
        """CheckFailed where such a message comes."""
        message = self.maybe(kind, where, within_s=during_s, mark=mark)
        if message is not None:
            raise CheckFailed(f"expected no {kind}, saw {message}")

    def ask(
        self,
        message: Any,
        kind: str,
        where: Where | None = None,
        *,
        within_s: float = REPLY_S,
        attempts: int = 3,
        source: tuple[int, int] = STATION,
    ) -> Any:
        """Send and wait for the answer, again where it does not come."""
        for _ in range(attempts):
            mark = self.mark()
            self.send(message, source)
            answer = self.maybe(kind, where, within_s=within_s, mark=mark)
            if answer is not None:
                return answer
        raise CheckFailed(f"expected {kind} for {message.get_type()}, saw none in {attempts} attempts")

    # -- commands ----------------------------------------------------------------------------------------

    def command_long(self, command: int, *params: float, confirmation: int = 0, to: Any = None) -> Any:
        padded = [*params, *[0.0] * (7 - len(params))]
        return mavlink.MAVLink_command_long_message(*(to or self.target), command, confirmation, *padded)

    def command_int(
        self,
        command: int,
        *params: float,
        frame: int = mavlink.MAV_FRAME_GLOBAL,
        x: int = 0,
        y: int = 0,
        z: float = 0.0,
    ) -> Any:
        padded = [*params, *[0.0] * (4 - len(params))]
        return mavlink.MAVLink_command_int_message(*self.target, frame, command, 0, 0, *padded, x, y, z)

    def result(self, message: Any, *, source: tuple[int, int] = STATION, attempts: int = 3) -> int:
        """Send a COMMAND_LONG or COMMAND_INT and wait for its final MAV_RESULT."""
        command = message.command
        for attempt in range(attempts):
            if message.get_type() == "COMMAND_LONG":
                message.confirmation = attempt
            mark = self.mark()
            self.send(message, source)
            ack = self._ack(command, source, mark, REPLY_S)
            if ack is not None and ack.result == mavlink.MAV_RESULT_IN_PROGRESS:
                ack = self.maybe(
                    "COMMAND_ACK",
                    lambda m: m.command == command and m.result != mavlink.MAV_RESULT_IN_PROGRESS,
                    within_s=IN_PROGRESS_S,
                    mark=mark,
                )
            if ack is not None:
                return int(ack.result)
        raise CheckFailed(
            f"expected a COMMAND_ACK for {command_name(command)}, saw none in {attempts} attempts"
        )

    def _ack(self, command: int, source: tuple[int, int], mark: int, within_s: float) -> Any | None:
        return self.maybe(
            "COMMAND_ACK",
            lambda m: m.command == command and m.target_system in (0, source[0]),
            within_s=within_s,
            mark=mark,
        )

    def command(self, command: int, *params: float) -> int:
        """COMMAND_LONG; its final MAV_RESULT."""
        return self.result(self.command_long(command, *params))

    def accepted(self, command: int, *params: float) -> None:
        """COMMAND_LONG that has to be accepted."""
        equal(result_name(self.command(command, *params)), "ACCEPTED", command_name(command))

    # -- messages on demand ------------------------------------------------------------------------------

    def request(self, kind: str, *params: float) -> Any:
        """A message by REQUEST_MESSAGE; Skip where the vehicle does not offer it."""
        message_id = id_of(kind)
        mark = self.mark()
        result = self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id, *params)
        if result != mavlink.MAV_RESULT_ACCEPTED:
            raise Skip(f"does not send {kind} on request ({result_name(result)})")
        return self.expect(kind, mark=mark, what=f"{kind} after its request was accepted")

    def set_interval(self, kind: str, rate_hz: float) -> int:
        """SET_MESSAGE_INTERVAL; -1 stops the stream, 0 asks for the default. MAV_RESULT."""
        interval_us = rate_hz if rate_hz <= 0 else 1e6 / rate_hz
        return self.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, id_of(kind), interval_us)

    @contextmanager
    def streaming(self, rates_hz: Mapping[str, float]) -> Iterator[None]:
        """Messages at these rates, and the default rates afterwards; Skip where one does not stream."""
        try:
            for kind, rate_hz in rates_hz.items():
                result = self.set_interval(kind, rate_hz)
                if result != mavlink.MAV_RESULT_ACCEPTED:
                    raise Skip(f"does not stream {kind} ({result_name(result)})")
            yield
        finally:
            with self.tidying():
                for kind in rates_hz:
                    self.set_interval(kind, 0)

    def sample(self, rates_hz: Mapping[str, float], seconds: float) -> dict[str, list[Any]]:
        """What comes of these streams in so many seconds, at least one of each."""
        with self.streaming(rates_hz):
            mark = self.wait(seconds)
            found = {kind: self.since(mark, kind) for kind in rates_hz}
        for kind, messages in found.items():
            if not messages:
                raise CheckFailed(f"expected {kind} at {rates_hz[kind]:g} Hz, saw none in {seconds:g} s")
        return found


_UNSAID = object()


def known(peer: Peer, *, ardupilot: Any = _UNSAID, px4: Any = _UNSAID) -> Any:
    """What this vehicle's autopilot is known to do; Skip where nobody has observed it."""
    value = {"ardupilot": ardupilot, "px4": px4}.get(peer.dialect.name, _UNSAID)
    if value is _UNSAID:
        raise Skip("the specification leaves this open, and this autopilot's habit is not known")
    return value
