"""The writers of evidence: messages on the link, agents, and actions of people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from swarmctl.agent.state import AgentState
from swarmctl.core import events as ev
from swarmctl.core.frames import AgentMessage
from swarmctl.core.vehicle import VehicleState
from swarmctl.mavlink.protocol.codec import Message
from swarmctl.report.evidence.file import EvidenceFile, Signer
from swarmctl.report.evidence.story import event_entries, state_changes
from swarmctl.report.evidence.traffic import ITEMS, KEEP_ALIVE, Traffic, arms
from swarmctl.report.evidence.transfer import NewEntry


class Evidence:
    """The evidence of one run: an `EvidenceRecorder` for the front end, and an `Observer` for runners."""

    def __init__(self, file: EvidenceFile, names: Mapping[int, str]) -> None:
        self._file = file
        self._names = names
        self._traffic: dict[tuple[int, str], Traffic] = {}
        """by vehicle and sending station; an empty name is this station"""
        self._in_transfer: set[tuple[int, str]] = set()
        """vehicles and stations whose transfers may have items or answers without an entry"""
        self._states: dict[int, VehicleState] = {}

    # The wire

    def to_vehicle(self, sysid: int, message: Message, by: str = "") -> bool:
        """Record a message to the vehicle `sysid` (0: all) and return whether the message may be sent.

        A message that arms a vehicle may be sent only if it was recorded. `by` names another station.
        """
        if message.get_type() in KEEP_ALIVE:
            if not by:
                self._write_running_transfers()
            return True
        if message.get_type() in ITEMS:
            self._in_transfer.add((sysid, by))
        is_arming = arms(message)
        recorded = True
        for kind, what in self._traffic_of(sysid, by).sent(message):
            content = {**what, "by": by} if by else what
            recorded = self._file.add(kind, content, self._name(sysid), durable=is_arming)
        return recorded or not is_arming

    def from_vehicle(self, sysid: int, message: Message) -> None:
        traffic = self._traffic_of(sysid, "")
        self._write(sysid, traffic.received(message))
        if message.get_type() == "MISSION_ACK":
            self._in_transfer.add((sysid, ""))
        if message.get_type() == "HEARTBEAT":
            for (vehicle, _), others_traffic in self._traffic.items():
                if vehicle == sysid:
                    others_traffic.byte_wise = traffic.byte_wise

    async def wait_until_stored(self) -> str:
        return await self._file.wait_until_stored()

    # The agents

    def folded(
        self, before: AgentState, event: ev.Event, after: AgentState, effects: list[ev.Effect], now: float
    ) -> None:
        uav = after.task.uav
        if isinstance(event, ev.TelemetryReceived):
            self._write(uav, state_changes(self._states.get(uav, VehicleState()), event.state))
            self._states[uav] = event.state
        self._write(uav, event_entries(event, effects))

    def sent(self, uav: int, message: AgentMessage, recipients: int, now: float) -> None:
        pass

    def noted(self, uav: int, text: str, now: float, *, to_operator: bool) -> None:
        if to_operator:
            self._file.add("note", {"said": text}, self._name(uav))

    # People

    def waived(self, vehicle: str | None, check: str, because: str = "") -> None:
        """Record that an operator lets a preflight check fail."""
        self._file.add("waiver", {"check": check, "because": because}, vehicle)

    def operator(self, action: str, vehicle: str | None = None, **more: Any) -> None:
        """Record an action of a person."""
        self._file.add("operator", {"asks": action, **more}, vehicle)

    def remark(self, text: str, vehicle: str | None = None) -> None:
        """Record a note about this run."""
        self._file.add("note", {"said": text}, vehicle)

    def close(self, signer: Signer | None = None) -> None:
        """End the chain. Idempotent."""
        if self._file.is_closed:
            return
        self._write_running_transfers()
        self._file.close(signer)

    @property
    def trouble(self) -> str:
        return self._file.trouble

    def _write_running_transfers(self) -> None:
        """Write entries of running transfers. A call at each keep-alive message limits a crash's loss."""
        for sysid, by in sorted(self._in_transfer):
            entries = self._traffic_of(sysid, by).unrecorded_entries()
            self._write(sysid, [(kind, {**what, "by": by} if by else what) for kind, what in entries])
        self._in_transfer.clear()

    def _write(self, sysid: int, entries: list[NewEntry]) -> None:
        for kind, what in entries:
            self._file.add(kind, what, self._name(sysid))

    def _traffic_of(self, sysid: int, by: str) -> Traffic:
        found = self._traffic.get((sysid, by))
        if found is None:
            found = self._traffic[sysid, by] = Traffic()
        return found

    def _name(self, sysid: int) -> str | None:
        return self._names.get(sysid, f"system {sysid}") if sysid else None
