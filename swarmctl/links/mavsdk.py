"""`MavsdkLink`: commands and missions by MAVSDK, over the front end. Only this module imports MAVSDK.

All MAVSDK links of a front end share one `Mavsdk` object, on `raw://`. Addresses, tlogs, signing, forwarding,
telemetry and every decision stay with this program.

Observed on MAVSDK 4.1.0: the library crashes on more than 16 objects in a process, on any call after
`destroy`, and on `destroy` in a callback. A cancelled blocking call never returns. So this module makes no
blocking calls, and calls `destroy` once, in the loop's thread.
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
"""number of time-outs after which MAVSDK ends a command"""
_COMMAND_TIMEOUT_S = Command.ANSWER_WAIT_S / _REPEATS
_TRANSFER_TIMEOUT_S = 1.5
"""MAVSDK's time-out in a transfer; five in a row end the transfer. ArduPilot requests a lost item every
second, so the default of 0.5 s is too short."""
_CALLBACKS_KEPT = 64
"""number of callbacks kept for each plug-in; MAVSDK itself drops none, and older callbacks are not pending"""
_MAX_CLOCK_GAP_S = 1.0
"""largest difference between the loop's clock and the machine's monotonic clock"""
_ATTACH_AFTER_S = 0.1


class MavsdkStation:
    """Owner of a front end's only `Mavsdk` object, from the front end's first MAVSDK link to the last."""

    def __init__(self, front_end: FrontEnd) -> None:
        self._loop = asyncio.get_running_loop()
        self._attach_is_due = False
        self._vehicles: dict[int, MavsdkVehicle] = {}
        self._plugins: dict[int, tuple[Any, Any]] = {}
        """plug-ins by system id: a shared pair would mix the transfers of two vehicles"""
        self._splitter, self._decoder = FrameSplitter(), Decoder()
        # MAVSDK's log would go to the terminal, which belongs to the user interface.
        log_subscribe(lambda *_: True)
        configuration = Configuration.create_manual(front_end.sysid, front_end.compid, False)
        self._mavsdk: Mavsdk | None = Mavsdk(configuration)
        self._set_timeout = self._mavsdk._lib.mavsdk_set_timeout_s
        self._set_timeout.argtypes = [ctypes.c_void_p, ctypes.c_double]
        connected = self._mavsdk.add_any_connection("raw://")
        if connected != ConnectionResult.SUCCESS:
            self.close()
            raise LinkError(f"MAVSDK does not open raw://: {connected.name}")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(partial(self._call_in_loop, self._on_outgoing))
        self._mavsdk.subscribe_on_new_system(lambda _: self._call_in_loop(self._on_new_system), None)

    def join(self, vehicle: MavsdkVehicle) -> None:
        """Add a vehicle. Raises LinkError if another vehicle has its system id, MAVSDK's key of a vehicle."""
        if vehicle.sysid in self._vehicles:
            raise LinkError(
                f"system id {vehicle.sysid} is used by two vehicles with `link: mavsdk`; give one vehicle "
                "another id, or `link: direct` [system-id-twice]"
            )
        self._vehicles[vehicle.sysid] = vehicle

    def leave(self, vehicle: MavsdkVehicle) -> bool:
        """Remove a vehicle; if no vehicle is left, close MAVSDK and return True. Idempotent."""
        if self._vehicles.get(vehicle.sysid) is vehicle:
            del self._vehicles[vehicle.sysid]
        if not self._vehicles:
            self.close()
        return not self._vehicles

    def feed(self, message: Message) -> None:
        if self._mavsdk is not None:
            self._mavsdk.pass_received_raw_bytes(bytes(message.get_msgbuf()))

    def set_timeout(self, timeout_s: float) -> None:
        """Set MAVSDK's time-out for the next call."""
        if self._mavsdk is not None:
            self._set_timeout(self._mavsdk._handle, timeout_s)

    def _call_in_loop(self, call: Callable[..., None], *args: Any) -> None:
        """Call a function in the loop, from one of MAVSDK's threads."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(call, *args)

    def callback(self, call: Callable[..., None]) -> Callable[..., None]:
        """Return a callback for MAVSDK that calls `call` in the loop, without MAVSDK's last argument."""
        return lambda *values: self._call_in_loop(call, *values[:-1])

    def _on_new_system(self) -> None:
        # A whole swarm is found within a second, and each `get_systems` makes handles for all systems.
        if not self._attach_is_due:
            self._attach_is_due = True
            self._loop.call_later(_ATTACH_AFTER_S, self._attach_found_systems)

    def _attach_found_systems(self) -> None:
        self._attach_is_due = False
        if self._mavsdk is None:
            return
        for system in self._mavsdk.get_systems():
            vehicle = self._vehicles.get(system.get_system_id())
            if vehicle is not None and not vehicle.discovered.is_set():
                if vehicle.sysid not in self._plugins:
                    self._plugins[vehicle.sysid] = MavlinkDirect(system), MissionRaw(system)
                vehicle.attach_plugins(*self._plugins[vehicle.sysid])

    def _on_outgoing(self, data: bytes) -> None:
        for frame in self._splitter.feed(data):
            message = self._decoder.decode(frame)
            vehicle = self._vehicles.get(getattr(message, "target_system", 0))
            if message is not None and vehicle is not None and vehicle.gate.lets_out(message):
                vehicle.send([message])

    def close(self) -> None:
        """Stop MAVSDK. Idempotent."""
        mavsdk, self._mavsdk = self._mavsdk, None
        if mavsdk is not None:
            # `destroy` frees the plug-ins' callbacks, then calls the pending callbacks. These references keep
            # the callbacks valid until `destroy` returns.
            for vehicle in self._vehicles.values():
                vehicle.detach_plugins()
            callbacks = [tuple(plugin._callbacks) for pair in self._plugins.values() for plugin in pair]
            mavsdk.destroy()
            callbacks.clear()
        self._vehicles.clear()


_STATIONS: WeakKeyDictionary[FrontEnd, MavsdkStation] = WeakKeyDictionary()


class MavsdkVehicle:
    """`MavsdkAdapter` of one vehicle: one transfer at a time."""

    def __init__(self, station: MavsdkStation, sysid: int, send: Callable[[list[Message]], None]) -> None:
        self.sysid = sysid
        self.send = send
        self.gate = MavsdkGate()
        self.discovered = asyncio.Event()
        """set when MAVSDK has discovered the vehicle"""
        self._station = station
        self._direct: Any = None
        self._raw: Any = None
        self._acks: dict[int, Message] = {}
        self._next_transfer: Callable[[], None] | None = None

    def attach_plugins(self, direct: Any, raw: Any) -> None:
        self._direct, self._raw = direct, raw
        self.discovered.set()

    def detach_plugins(self) -> None:
        """Drop the plug-ins before MAVSDK closes; later calls get no answer."""
        self._direct = self._raw = None

    def receive(self, message: Message) -> None:
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
            reported = json.loads(answer.fields_json) if answer.fields_json else {}
            if ack is not None and reported.get("result") == ack.result:
                then(ack)

        if self._direct is None:
            return
        self._station.set_timeout(_COMMAND_TIMEOUT_S)
        self._drop_old_callbacks(self._direct)
        self._direct.send_command_async(
            MavlinkMessage("COMMAND_LONG", fields_json=json.dumps(fields)), self._station.callback(answered)
        )

    def give_up(self, message: Message) -> None:
        self.gate.revoke(message)
        self._acks.pop(int(message.command), None)

    def upload(self, items: Sequence[MissionItem], current: int, then: Callable[[TransferEnd], None]) -> None:
        raw = [_raw_item(seq, item, seq == current) for seq, item in enumerate(items)]
        self._transfer(lambda plugin, ended: plugin.upload_mission_async(raw, ended), then)

    def download(self, then: Callable[[TransferEnd], None]) -> None:
        self._transfer(lambda plugin, ended: plugin.download_mission_async(ended), then)

    def cancel_transfer(self) -> None:
        self._next_transfer = None
        if self.gate.is_transferring and self._raw is not None:
            for cancel in (self._raw.cancel_mission_upload, self._raw.cancel_mission_download):
                # Cancelling the direction without a transfer raises.
                try:
                    cancel()
                except MissionRawError:
                    continue

    def _transfer(self, begin: Callable[[Any, Any], None], then: Callable[[TransferEnd], None]) -> None:
        def start() -> None:
            if self._raw is None:
                return
            self.gate.is_transferring = True
            self._station.set_timeout(_TRANSFER_TIMEOUT_S)
            self._drop_old_callbacks(self._raw)
            begin(self._raw, self._station.callback(ended))

        def ended(result: Any, items: Sequence[Any] = ()) -> None:
            self.gate.is_transferring = False
            then((result.name, tuple(map(_item, items))))
            start_next, self._next_transfer = self._next_transfer, None
            if start_next is not None and not self.gate.is_transferring:
                start_next()

        if self.gate.is_transferring:
            # The cancelled transfer has not ended yet, so MAVSDK would answer BUSY.
            self._next_transfer = start
        else:
            start()

    @staticmethod
    def _drop_old_callbacks(plugin: Any) -> None:
        del plugin._callbacks[:-_CALLBACKS_KEPT]


class _WakingSession(Session):
    """Session that can also continue its procedure without a message or a deadline."""

    def wake(self, now: float) -> SessionStep:
        if self._driver is not None:
            self._driver.next_deadline = now
        return self.tick(now)


class MavsdkLink(DirectLink):
    """`Link` with commands and missions by MAVSDK.

    MAVSDK needs the machine's clock: `connect` raises LinkError on a virtual clock.
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
        self._vehicle: MavsdkVehicle | None = None

    async def connect(self, timeout_s: float) -> Identity:
        identity = await super().connect(timeout_s)
        assert self._vehicle is not None
        try:
            async with asyncio.timeout(timeout_s):
                await self._vehicle.discovered.wait()
        except TimeoutError:
            raise LinkError(
                f"{self._label}: the vehicle answers, but MAVSDK has not found this vehicle within "
                f"{timeout_s:g} s; try again, or fly with `link: direct`"
            ) from None
        return identity

    def close(self) -> None:
        super().close()
        vehicle, self._vehicle = self._vehicle, None
        station = _STATIONS.get(self._front_end)
        if vehicle is not None and station is not None and station.leave(vehicle):
            del _STATIONS[self._front_end]

    def _close_station(self) -> None:
        station = _STATIONS.pop(self._front_end, None)
        if station is not None:
            station.close()

    async def _attach(self) -> None:
        if self._vehicle is None:
            loop_s = asyncio.get_running_loop().time()
            if abs(loop_s - time.monotonic()) > _MAX_CLOCK_GAP_S:
                raise LinkError(
                    f"{self.name}: MAVSDK uses the machine's clock, but this run has a virtual clock; "
                    "fly in real time, or with `link: direct` [virtual-clock]"
                )
            station = _STATIONS.get(self._front_end)
            if station is None:
                station = _STATIONS[self._front_end] = MavsdkStation(self._front_end)
                self._front_end.at_close(self._close_station)
            vehicle = MavsdkVehicle(station, self.sysid, self._send)
            station.join(vehicle)
            self._vehicle = vehicle
        await super()._attach()

    async def _perform(self, name: str, procedure: Callable[[Context], Procedure[Any]]) -> Any:
        vehicle = self._vehicle

        def by_mavsdk(context: Context) -> Procedure[Any]:
            assert vehicle is not None
            return with_mavsdk(procedure(context), vehicle, self._wake, self._now)

        return await super()._perform(name, procedure if vehicle is None else by_mavsdk)

    def _on_message(self, message: Message) -> None:
        if self._vehicle is not None:
            self._vehicle.receive(message)
        super()._on_message(message)

    def _send(self, messages: list[Message]) -> None:
        if self._channel is not None:
            self._channel.send(messages)

    def _wake(self) -> None:
        if self._channel is not None:
            self._apply(self._session.wake(self._now()))


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
