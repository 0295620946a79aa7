"""`MavsdkLink`: MAVSDK's stack for commands and missions, over our front end. The only file that imports it.

One `Mavsdk` object a front end, fed and drained by `raw://`: addresses, tlogs, signing and forwarding stay
ours, and so do telemetry and every decision. Observed on MAVSDK 4.1.0: it is crashed by more than 16 objects
in a process, by any call after `destroy`, and by `destroy` in a callback; a blocking call that is cancelled
never returns. So it is used by its `_async` calls only, from the loop's thread, and destroyed there once.
"""

from __future__ import annotations

import asyncio
import ctypes
import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from mavsdk import Configuration, ConnectionResult, Mavsdk, log_subscribe
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError

from swarmctl.core.mission import MissionItem
from swarmctl.links.base import Identity, LinkError
from swarmctl.links.direct import DirectLink
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.mavsdk_conversations import MavsdkGate, TransferEnd, with_mavsdk
from swarmctl.mavlink.protocol.codec import Decoder, FrameSplitter, Message
from swarmctl.mavlink.protocol.command import Command
from swarmctl.mavlink.protocol.conversation import MavlinkPeer
from swarmctl.mavlink.protocol.mission_upload import MISSION
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.session import Session, SessionStep
from swarmctl.mavlink.telemetry.streams import Streaming

_REPEATS = 4
"""how often MAVSDK waits for its time-out before it gives a command up"""
_COMMAND_TIMEOUT_S = Command.ANSWER_S / _REPEATS
_TRANSFER_TIMEOUT_S = 1.5
"""five in a row end a transfer: ArduPilot, which asks for a lost item once a second, needs them longer than
MAVSDK's usual half second"""
_CALLBACKS_KEPT = 64
"""MAVSDK's plug-ins keep every callback for ever; later than so many calls none is still to come"""
_CLOCKS_APART_S = 1.0
_LOOK_UP_AFTER_S = 0.1


class MavsdkStation:
    """The one `Mavsdk` object of a front end, from the first link on it to the last."""

    def __init__(self, front_end: FrontEnd) -> None:
        self._loop = asyncio.get_running_loop()
        self._looking = False
        self._vehicles: dict[int, MavsdkVehicle] = {}
        self._plugins: dict[int, tuple[Any, Any]] = {}
        """by system id, as long as MAVSDK: one pair a vehicle, or their transfers would mix"""
        self._splitter, self._decoder = FrameSplitter(), Decoder()
        # Its log goes to the terminal, which is taken; what matters of it comes back as results.
        log_subscribe(lambda *_: True)
        configuration = Configuration.create_manual(front_end.sysid, front_end.compid, False)
        self._mavsdk: Mavsdk | None = Mavsdk(configuration)
        self._set_timeout = self._mavsdk._lib.mavsdk_set_timeout_s
        self._set_timeout.argtypes = [ctypes.c_void_p, ctypes.c_double]
        connected = self._mavsdk.add_any_connection("raw://")
        if connected != ConnectionResult.SUCCESS:
            self.close()
            raise LinkError(f"MAVSDK does not open raw://: {connected.name}")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(partial(self._later, self._drained))
        self._mavsdk.subscribe_on_new_system(lambda _: self._later(self._found), None)

    def join(self, vehicle: MavsdkVehicle) -> None:
        """Raises LinkError where another vehicle has its system id: MAVSDK knows them by nothing else."""
        if vehicle.sysid in self._vehicles:
            raise LinkError(
                f"system id {vehicle.sysid} is used by two vehicles with `link: mavsdk`; give one of them "
                "another, or `link: direct`"
            )
        self._vehicles[vehicle.sysid] = vehicle

    def leave(self, vehicle: MavsdkVehicle) -> bool:
        """Idempotent; returns whether it was the last one, and MAVSDK is gone."""
        if self._vehicles.get(vehicle.sysid) is vehicle:
            del self._vehicles[vehicle.sysid]
        if not self._vehicles:
            self.close()
        return not self._vehicles

    def feed(self, message: Message) -> None:
        if self._mavsdk is not None:
            self._mavsdk.pass_received_raw_bytes(bytes(message.get_msgbuf()))

    def allow(self, timeout_s: float) -> None:
        """How patient MAVSDK is with what is begun next."""
        if self._mavsdk is not None:
            self._set_timeout(self._mavsdk._handle, timeout_s)

    def _later(self, call: Callable[..., None], *args: Any) -> None:
        """From MAVSDK's threads into the loop."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(call, *args)

    def callback(self, call: Callable[..., None]) -> Callable[..., None]:
        """For MAVSDK to call, whose last argument is of no use."""
        return lambda *values: self._later(call, *values[:-1])

    def _found(self) -> None:
        # All of a swarm are found within a second, and each look makes handles for all of them.
        if not self._looking:
            self._looking = True
            self._loop.call_later(_LOOK_UP_AFTER_S, self._look_up)

    def _look_up(self) -> None:
        self._looking = False
        if self._mavsdk is None:
            return
        for system in self._mavsdk.get_systems():
            vehicle = self._vehicles.get(system.get_system_id())
            if vehicle is not None and not vehicle.known.is_set():
                if vehicle.sysid not in self._plugins:
                    self._plugins[vehicle.sysid] = MavlinkDirect(system), MissionRaw(system)
                vehicle.embark(*self._plugins[vehicle.sysid])

    def _drained(self, data: bytes) -> None:
        for frame in self._splitter.feed(data):
            message = self._decoder.decode(frame)
            vehicle = self._vehicles.get(getattr(message, "target_system", 0))
            if message is not None and vehicle is not None and vehicle.gate.lets_out(message):
                vehicle.send([message])

    def close(self) -> None:
        """Idempotent; ends whatever MAVSDK is doing."""
        mavsdk, self._mavsdk = self._mavsdk, None
        if mavsdk is not None:
            # Its plug-ins drop their callbacks first, and then it calls those of what is under way: held
            # until it is over, or that is memory of somebody else's.
            for vehicle in self._vehicles.values():
                vehicle.abandon()
            held = [tuple(plugin._callbacks) for pair in self._plugins.values() for plugin in pair]
            mavsdk.destroy()
            held.clear()
        self._vehicles.clear()


_STATIONS: WeakKeyDictionary[FrontEnd, MavsdkStation] = WeakKeyDictionary()


class MavsdkVehicle:
    """One vehicle as MAVSDK has it. Fits `Adapter`: one transfer at a time, whoever asks."""

    def __init__(self, station: MavsdkStation, sysid: int, send: Callable[[list[Message]], None]) -> None:
        self.sysid = sysid
        self.send = send
        self.gate = MavsdkGate()
        self.known = asyncio.Event()
        """MAVSDK has heard of it"""
        self._station = station
        self._direct: Any = None
        self._raw: Any = None
        self._acks: dict[int, Message] = {}
        self._next: Callable[[], None] | None = None

    def embark(self, direct: Any, raw: Any) -> None:
        self._direct, self._raw = direct, raw
        self.known.set()

    def abandon(self) -> None:
        """MAVSDK is about to go; what is asked of it from now on is not answered, as by a dead vehicle."""
        self._direct = self._raw = None

    def hear(self, message: Message) -> None:
        if self.gate.lets_in(message):
            if message.get_type() == "COMMAND_ACK":
                self._acks[int(message.command)] = message
            self._station.feed(message)

    def command(self, message: Message, then: Callable[[Message], None]) -> None:
        self.gate.permit(message)
        fields = {f"param{i}": getattr(message, f"param{i}") for i in range(1, 8)}
        fields |= {
            "target_system": message.target_system,
            "target_component": message.target_component,
            "command": message.command,
            "confirmation": message.confirmation,
        }

        def answered(_result: Any, answer: Any) -> None:
            ack = self._acks.get(int(message.command))
            said = json.loads(answer.fields_json) if answer.fields_json else {}
            if ack is not None and said.get("result") == ack.result:
                then(ack)

        if self._direct is None:
            return
        self._station.allow(_COMMAND_TIMEOUT_S)
        self._trim(self._direct)
        self._direct.send_command_async(
            MavlinkMessage("COMMAND_LONG", fields_json=json.dumps(fields)), self._station.callback(answered)
        )

    def give_up(self, message: Message) -> None:
        self.gate.revoke(message)
        self._acks.pop(int(message.command), None)

    def upload(self, items: Sequence[MissionItem], current: int, then: Callable[[TransferEnd], None]) -> None:
        raw = [_raw_item(seq, item, seq == current) for seq, item in enumerate(items)]
        self._transfer(lambda by, ended: by.upload_mission_async(raw, ended), then)

    def download(self, then: Callable[[TransferEnd], None]) -> None:
        self._transfer(lambda by, ended: by.download_mission_async(ended), then)

    def cancel_transfer(self) -> None:
        self._next = None
        if self.gate.transfer and self._raw is not None:
            for cancel in (self._raw.cancel_mission_upload, self._raw.cancel_mission_download):
                # Whichever of them does not run says so.
                try:
                    cancel()
                except MissionRawError:
                    continue

    def _transfer(self, begin: Callable[[Any, Any], None], then: Callable[[TransferEnd], None]) -> None:
        def start() -> None:
            if self._raw is None:
                return
            self.gate.transfer = True
            self._station.allow(_TRANSFER_TIMEOUT_S)
            self._trim(self._raw)
            begin(self._raw, self._station.callback(ended))

        def ended(result: Any, items: Sequence[Any] = ()) -> None:
            self.gate.transfer = False
            then((result.name, tuple(map(_item, items))))
            following, self._next = self._next, None
            if following is not None and not self.gate.transfer:
                following()

        if self.gate.transfer:
            # The end of one that was cancelled is still to come; MAVSDK would call itself busy.
            self._next = start
        else:
            start()

    @staticmethod
    def _trim(plugin: Any) -> None:
        del plugin._callbacks[:-_CALLBACKS_KEPT]


class _WakingSession(Session):
    """Whose procedure also goes on when something else than a message or a deadline lets it."""

    def wake(self, now: float) -> SessionStep:
        if self._driver is not None:
            self._driver.next_deadline = now
        return self.tick(now)


class MavsdkLink(DirectLink):
    """Fits `Link`: `DirectLink`, whose commands and missions go through MAVSDK.

    Needs the machine's clock: connect raises LinkError on a virtual one.
    """

    _session: _WakingSession

    def __init__(
        self,
        front_end: FrontEnd,
        *args: Any,
        lost_after_s: float = 5.0,
        streaming: Streaming | None = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(front_end, *args, lost_after_s=lost_after_s, **kwargs)
        peer = MavlinkPeer(self.sysid, own_sysid=front_end.sysid, own_compid=front_end.compid)
        self._session = _WakingSession(peer, lost_after_s, streaming)
        self._aboard: MavsdkVehicle | None = None

    async def connect(self, timeout_s: float) -> Identity:
        identity = await super().connect(timeout_s)
        assert self._aboard is not None
        try:
            async with asyncio.timeout(timeout_s):
                await self._aboard.known.wait()
        except TimeoutError:
            raise LinkError(
                f"{self._who}: it answers, but MAVSDK has not discovered it within {timeout_s:g} s; "
                "`link: direct` does without MAVSDK"
            ) from None
        return identity

    def close(self) -> None:
        super().close()
        aboard, self._aboard = self._aboard, None
        station = _STATIONS.get(self._front_end)
        if aboard is not None and station is not None and station.leave(aboard):
            del _STATIONS[self._front_end]

    def _close_station(self) -> None:
        station = _STATIONS.pop(self._front_end, None)
        if station is not None:
            station.close()

    async def _attach(self) -> None:
        if self._aboard is None:
            loop_s = asyncio.get_running_loop().time()
            if abs(loop_s - time.monotonic()) > _CLOCKS_APART_S:
                raise LinkError(
                    f"{self.name}: MAVSDK keeps to the machine's clock and this run's is a virtual one; "
                    "fly in real time, or with `link: direct`"
                )
            station = _STATIONS.get(self._front_end)
            if station is None:
                station = _STATIONS[self._front_end] = MavsdkStation(self._front_end)
                self._front_end.at_close(self._close_station)
            aboard = MavsdkVehicle(station, self.sysid, self._send)
            station.join(aboard)
            self._aboard = aboard
        await super()._attach()

    async def _perform(self, name: str, procedure: Callable[[Context], Procedure[Any]]) -> Any:
        aboard = self._aboard

        def by_mavsdk(context: Context) -> Procedure[Any]:
            assert aboard is not None
            return with_mavsdk(procedure(context), aboard, self._wake, self._now)

        return await super()._perform(name, procedure if aboard is None else by_mavsdk)

    def _on_message(self, message: Message) -> None:
        if self._aboard is not None:
            self._aboard.hear(message)
        super()._on_message(message)

    def _send(self, messages: list[Message]) -> None:
        if self._channel is not None:
            self._channel.send(messages)

    def _wake(self) -> None:
        if self._channel is not None:
            self._take(self._session.wake(self._now()))


def _raw_item(seq: int, item: MissionItem, current: bool) -> RawItem:
    return RawItem(
        seq,
        item.frame,
        item.command,
        int(current),
        item.autocontinue,
        item.param1,
        item.param2,
        item.param3,
        item.param4,
        item.x,
        item.y,
        item.z,
        MISSION,
    )


def _item(raw: RawItem) -> MissionItem:
    return MissionItem(
        command=raw.command,
        frame=raw.frame,
        x=raw.x,
        y=raw.y,
        z=raw.z,
        param1=raw.param1,
        param2=raw.param2,
        param3=raw.param3,
        param4=raw.param4,
        autocontinue=raw.autocontinue,
    )
