"""`MavsdkLink`: commands and missions by MAVSDK, over the front end. Only this module imports MAVSDK.

All MAVSDK links of a front end share one `Mavsdk` object, on `raw://`. Addresses, tlogs, signing, forwarding,
telemetry and every decision stay with this program.

Observed on MAVSDK 4.1.0: the library crashes on more than 16 objects in a process, on any call after
`destroy`, and on `destroy` in a callback. A cancelled blocking call never returns. So this module makes no
call that waits for a vehicle, and calls `destroy` once, in the loop's thread.
"""

from __future__ import annotations

import asyncio
import ctypes
import json
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from mavsdk import Configuration, ConnectionResult, Mavsdk, log_subscribe
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage
from mavsdk.plugins.mission_raw import MissionItem as RawItem
from mavsdk.plugins.mission_raw import MissionRaw, MissionRawError

from swarmctl.core.mission import MissionItem
from swarmctl.links.base import LinkError
from swarmctl.links.direct import DirectLink
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.mavsdk_conversations import MavsdkGate, OnEnd, with_mavsdk
from swarmctl.mavlink.events import Identity
from swarmctl.mavlink.protocol.codec import GCS_COMPID, GCS_SYSID, FrameSplitter, Message, decode
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.session import SessionStep

_TRANSFER_TIMEOUT_S = 1.5
"""MAVSDK's time-out in a transfer; five in a row end the transfer. ArduPilot requests a lost item every
second, so the default of 0.5 s is too short."""
_MAX_CLOCK_GAP_S = 1.0
"""largest difference between the loop's clock and the machine's monotonic clock"""
_ITEM_FIELDS = MissionItem.__struct_fields__


class MavsdkStation:
    """Owner of a front end's only `Mavsdk` object, from the front end's first MAVSDK link to the last."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._links: dict[int, MavsdkLink] = {}
        self._plugins: dict[int, tuple[Any, Any]] = {}
        """plug-ins by system id: a shared pair would mix the transfers of two vehicles"""
        self._splitter = FrameSplitter()
        # MAVSDK's log would go to the terminal, which belongs to the user interface.
        log_subscribe(lambda *_: True)
        configuration = Configuration.create_manual(GCS_SYSID, GCS_COMPID, False)
        self._mavsdk: Mavsdk | None = Mavsdk(configuration)
        set_timeout = self._mavsdk._lib.mavsdk_set_timeout_s
        set_timeout.argtypes = [ctypes.c_void_p, ctypes.c_double]
        set_timeout(self._mavsdk._handle, _TRANSFER_TIMEOUT_S)
        connected = self._mavsdk.add_any_connection("raw://")
        if connected != ConnectionResult.SUCCESS:
            self.close()
            raise LinkError(f"MAVSDK does not open raw://: {connected.name}")
        self._mavsdk.subscribe_raw_bytes_to_be_sent(partial(self.call_in_loop, self._on_outgoing))
        self._mavsdk.subscribe_on_new_system(lambda _: self.call_in_loop(self._attach_plugins), None)

    def join(self, link: MavsdkLink) -> None:
        """Add a vehicle. Raises LinkError if another vehicle has its system id, MAVSDK's key of a vehicle."""
        if link.sysid in self._links:
            raise LinkError(
                f"system id {link.sysid} is used by two vehicles with `link: mavsdk`; give one vehicle "
                "another id, or `link: direct` [system-id-twice]"
            )
        self._links[link.sysid] = link
        self._attach_plugins()

    def leave(self, link: MavsdkLink) -> None:
        """Remove a vehicle; without vehicles, close MAVSDK. Idempotent."""
        if self._links.get(link.sysid) is link:
            del self._links[link.sysid]
        if not self._links:
            self.close()

    @property
    def is_open(self) -> bool:
        return self._mavsdk is not None

    def feed(self, message: Message) -> None:
        if self._mavsdk is not None:
            self._mavsdk.pass_received_raw_bytes(bytes(message.get_msgbuf()))

    def call_in_loop(self, call: Callable[..., None], *args: Any) -> None:
        """Call a function in the loop, from one of MAVSDK's threads."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(call, *args)

    def _attach_plugins(self) -> None:
        for system in self._mavsdk.get_systems() if self._mavsdk is not None else ():
            sysid = system.get_system_id()
            if sysid in self._links:
                if sysid not in self._plugins:
                    self._plugins[sysid] = MavlinkDirect(system), MissionRaw(system)
                self._links[sysid].attach_plugins(*self._plugins[sysid])

    def _on_outgoing(self, data: bytes) -> None:
        for frame in self._splitter.feed(data):
            message = decode(frame)
            link = self._links.get(getattr(message, "target_system", 0))
            if message is not None and link is not None:
                link.send_from_mavsdk(message)

    def close(self) -> None:
        """Stop MAVSDK. Idempotent."""
        mavsdk, self._mavsdk = self._mavsdk, None
        if mavsdk is not None:
            # `destroy` frees the plug-ins' callbacks, then calls the pending callbacks. These references keep
            # the callbacks valid until `destroy` returns.
            callbacks = [tuple(plugin._callbacks) for pair in self._plugins.values() for plugin in pair]
            mavsdk.destroy()
            callbacks.clear()


_STATIONS: WeakKeyDictionary[FrontEnd, MavsdkStation] = WeakKeyDictionary()


class MavsdkLink(DirectLink):
    """Link with commands and missions by MAVSDK.

    MAVSDK needs the machine's clock: `connect` raises LinkError on a virtual clock.
    """

    _gate: MavsdkGate
    _found: asyncio.Event
    """set when MAVSDK has found the vehicle"""
    _station: MavsdkStation | None = None
    _direct: Any = None
    """MAVSDK's plug-ins; None until MAVSDK has found the vehicle, and after the end"""
    _raw: Any = None

    async def connect(self, timeout_s: float) -> Identity:
        identity = await super().connect(timeout_s)
        try:
            async with asyncio.timeout(timeout_s):
                await self._found.wait()
        except TimeoutError:
            raise LinkError(
                f"{self._label}: the vehicle answers, but MAVSDK has not found this vehicle within "
                f"{timeout_s:g} s; try again, or fly with `link: direct`"
            ) from None
        return identity

    def close(self) -> None:
        super().close()
        station, self._station = self._station, None
        self._direct = self._raw = None
        if station is not None:
            station.leave(self)

    async def _attach(self) -> None:
        if self._station is None:
            loop_s = asyncio.get_running_loop().time()
            if abs(loop_s - time.monotonic()) > _MAX_CLOCK_GAP_S:
                raise LinkError(
                    f"{self.name}: MAVSDK uses the machine's clock, but this run has a virtual clock; "
                    "fly in real time, or with `link: direct` [virtual-clock]"
                )
            station = _STATIONS.get(self._front_end)
            if station is None or not station.is_open:
                station = _STATIONS[self._front_end] = MavsdkStation()
            self._gate, self._found = MavsdkGate(), asyncio.Event()
            station.join(self)
            self._station = station
        await super()._attach()

    # Messages between MAVSDK and the vehicle

    def attach_plugins(self, direct: Any, raw: Any) -> None:
        self._direct, self._raw = direct, raw
        self._found.set()

    def send_from_mavsdk(self, message: Message) -> None:
        if self._channel is not None and self._gate.lets_out(message, self._now()):
            self._channel.send([message])

    def _on_message(self, message: Message) -> None:
        if self._station is not None and self._gate.lets_in(message):
            self._station.feed(message)
        super()._on_message(message)

    def _apply(self, step: SessionStep) -> None:
        super()._apply(step._replace(messages=[m for m in step.messages if not self._send_by_mavsdk(m)]))

    def _send_by_mavsdk(self, message: Message) -> bool:
        """Send a command by MAVSDK; return False if the front end has to send the message."""
        if self._direct is None or message.get_type() != "COMMAND_LONG":
            return False
        fields = {name: getattr(message, name) for name in message.get_fieldnames()}
        try:
            self._direct.send_message(MavlinkMessage("COMMAND_LONG", fields_json=json.dumps(fields)))
        except MavlinkDirectError:
            return False
        self._gate.permit(message, self._now())
        return True

    # Mission transfers

    async def _perform(self, name: str, procedure: Callable[[Context], Procedure[Any]]) -> Any:
        return await super()._perform(name, lambda context: with_mavsdk(procedure(context), self))

    @property
    def is_transferring(self) -> bool:
        return self._gate.is_transferring

    def begin_upload(self, items: Sequence[MissionItem], current: int, on_end: OnEnd) -> None:
        raw = [
            RawItem(seq, current=int(seq == current), **{name: getattr(item, name) for name in _ITEM_FIELDS})
            for seq, item in enumerate(items)
        ]
        self._begin(lambda plugin, ended: plugin.upload_mission_async(raw, ended), on_end)

    def begin_download(self, on_end: OnEnd) -> None:
        self._begin(lambda plugin, ended: plugin.download_mission_async(ended), on_end)

    def cancel_transfer(self) -> None:
        if self.is_transferring and self._raw is not None:
            # Cancelling the direction without a transfer raises.
            for cancel in (self._raw.cancel_mission_upload, self._raw.cancel_mission_download):
                with suppress(MissionRawError):
                    cancel()

    def _begin(self, begin: Callable[[Any, Callable[..., None]], None], on_end: OnEnd) -> None:
        station, gate = self._station, self._gate
        if station is None or self._raw is None:
            on_end("NO_SYSTEM", ())
            return

        def ended(result: Any, raw: Sequence[RawItem] = ()) -> None:
            gate.is_transferring = False
            items = [MissionItem(**{name: getattr(r, name) for name in _ITEM_FIELDS}) for r in raw]
            on_end(result.name, tuple(items))

        gate.is_transferring = True
        # MAVSDK's last argument is the user's data, here None.
        begin(self._raw, lambda *values: station.call_in_loop(ended, *values[:-1]))
