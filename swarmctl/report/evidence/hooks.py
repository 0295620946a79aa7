"""Who writes into the book: the wire, the agents, and people's actions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.frames import Spoken
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.report.evidence.book import Book, Signer
from swarmctl.report.evidence.story import seen, told
from swarmctl.report.evidence.traffic import ITEMS, KEEP_ALIVE, Traffic, arms
from swarmctl.report.evidence.transfer import Said


class Evidence:
    """Fits the front end's `Witness` and the runners' `Observer`; one a run."""

    def __init__(self, book: Book, names: Mapping[int, str]) -> None:
        self._book = book
        self._names = names
        self._traffic: dict[tuple[int, str], Traffic] = {}
        """by vehicle and by who speaks to it; empty: we"""
        self._on_the_way: set[tuple[int, str]] = set()
        """of those, where items or answers to them have gone since that was told"""
        self._states: dict[int, VehicleState] = {}

    # The wire

    def to_vehicle(self, sysid: int, message: Message, by: str = "") -> bool:
        """Called before a message leaves, for the vehicle `sysid` (0: all of them); whether it may leave.

        Only what would arm a vehicle and cannot be recorded may not. `by` names another station.
        """
        if message.get_type() in KEEP_ALIVE:
            if not by:
                self._items_so_far()
            return True
        if message.get_type() in ITEMS:
            self._on_the_way.add((sysid, by))
        is_arming = arms(message)
        recorded = True
        for kind, what in self._traffic_of(sysid, by).sent(message):
            said = {**what, "by": by} if by else what
            recorded = self._book.add(kind, said, self._name(sysid), durable=is_arming)
        return recorded or not is_arming

    def from_vehicle(self, sysid: int, message: Message) -> None:
        own = self._traffic_of(sysid, "")
        self._write(sysid, own.heard(message))
        if message.get_type() == "MISSION_ACK":
            self._on_the_way.add((sysid, ""))
        if message.get_type() == "HEARTBEAT":
            for (other, _), traffic in self._traffic.items():
                if other == sysid:
                    traffic.byte_wise = own.byte_wise

    async def settled(self) -> str:
        """Wait until all this is on the disk; why it is not, empty if it is."""
        return await self._book.settled()

    # The agents

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        uav = after.task.uav
        if isinstance(event, ev.TelemetryReceived):
            self._write(uav, seen(self._states.get(uav, VehicleState()), event.state))
            self._states[uav] = event.state
        self._write(uav, told(event, effects))

    def sent(self, uav: int, message: Spoken, recipients: int, now: float) -> None:
        pass

    def said(self, uav: int, text: str, now: float, *, aloud: bool) -> None:
        if aloud:
            self._book.add("note", {"said": text}, self._name(uav))

    # People

    def waived(self, vehicle: str | None, check: str, because: str = "") -> None:
        """An operator lets a flight go on against a check."""
        self._book.add("waiver", {"check": check, "because": because}, vehicle)

    def operator(self, action: str, vehicle: str | None = None, **more: Any) -> None:
        """Something a person did at this program."""
        self._book.add("operator", {"asks": action, **more}, vehicle)

    def remark(self, text: str, vehicle: str | None = None) -> None:
        """What else is to be known of this run."""
        self._book.add("note", {"said": text}, vehicle)

    def close(self, signer: Signer | None = None) -> None:
        """End the chain. Idempotent."""
        if self._book.is_closed:
            return
        self._items_so_far()
        self._book.close(signer)

    @property
    def trouble(self) -> str:
        return self._book.trouble

    def _items_so_far(self) -> None:
        """Of what is on its way; with every heartbeat of ours, so that a process that dies leaves it."""
        for sysid, by in sorted(self._on_the_way):
            said = self._traffic_of(sysid, by).so_far()
            self._write(sysid, [(kind, {**what, "by": by} if by else what) for kind, what in said])
        self._on_the_way.clear()

    def _write(self, sysid: int, entries: list[Said]) -> None:
        for kind, what in entries:
            self._book.add(kind, what, self._name(sysid))

    def _traffic_of(self, sysid: int, by: str) -> Traffic:
        found = self._traffic.get((sysid, by))
        if found is None:
            found = self._traffic[sysid, by] = Traffic()
        return found

    def _name(self, sysid: int) -> str | None:
        return self._names.get(sysid, f"system {sysid}") if sysid else None
