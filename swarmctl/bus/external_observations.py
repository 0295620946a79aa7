"""Receiver of payloads' reports: one key for each vehicle, for puts and for queries.

A query under exactly this key gets an answer, a put gets none (formats: `swarmctl.bus.sensor_reports`). An
accepted report becomes an observation of the vehicle's agent, also on the ground and after the flight.
Refused reports are counted. The program shows each reason once, and again after a pause.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from swarmctl.bus import keys, sensor_reports
from swarmctl.bus.authentication import NO_AUTHENTICATION, Authentication
from swarmctl.bus.rate import TokenBucket
from swarmctl.bus.sensor_reports import RejectedReport, RejectReason, ReportAnswer, ReportedCells
from swarmctl.bus.transports.base import MAX_QUERY_BYTES, Reply, Transport
from swarmctl.core.grid import Grid
from swarmctl.core.messages import BadMessage
from swarmctl.core.operator_text import excerpt

PER_S = 50.0
BURST = 50
"""limits on the reports to one vehicle, accepted or refused: PER_S a second, BURST at once"""
SHOWN_AGAIN_AFTER_S = 10.0
"""time without a refusal for the same reason, after which a further refusal is shown"""


@dataclass(slots=True)
class ReportCounts:
    """Numbers of received reports."""

    taken: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    """number of refused reports, by reason"""


class ReportReceiver:
    """The receiver of one vehicle, active until the transport is closed.

    clock: wall clock [s since 1970], for the check of a report's time
    post: function that takes an accepted report's cells and source
    authentication: check of the sender
    tolerance_s: largest lead of a payload's clock [s]
    """

    def __init__(
        self,
        transport: Transport,
        swarm: str,
        uav: int,
        grid: Grid,
        clock: Callable[[], float],
        post: Callable[[ReportedCells, str], None],
        say: Callable[[str], None],
        *,
        tolerance_s: float = sensor_reports.CLOCK_TOLERANCE_S,
        authentication: Authentication = NO_AUTHENTICATION,
    ) -> None:
        self.counts = ReportCounts()
        self._key = keys.sensor_report(swarm, uav)
        self._grid = grid
        self._clock = clock
        self._post = post
        self._say = say
        self._tolerance_s = tolerance_s
        self._authentication = authentication
        self._bucket = TokenBucket(PER_S, BURST)
        self._refused_at_s: dict[RejectReason, float] = {}
        transport.subscribe(self._key, self._handle_put)
        transport.serve(self._key, self._answer_query)

    def _handle_put(self, key: str, payload: bytes) -> None:
        self._handle(key, payload)

    def _answer_query(self, key: str, payload: bytes | None, reply: Reply) -> None:
        answer = sensor_reports.encode(self._handle(key, payload))
        if key == self._key:
            reply(answer if payload is None else self._authentication.sign_answer(key, payload, answer))

    def _handle(self, key: str, payload: bytes | None) -> ReportAnswer:
        """Handle a report; None stands for a payload above the size limit."""
        now_s = asyncio.get_running_loop().time()
        try:
            cells, source = self._decode(key, payload, now_s)
        except RejectedReport as bad:
            return self._refuse(bad, now_s)
        self.counts.taken += 1
        self._post(cells, source)
        return ReportAnswer(taken=True, cells=cells)

    def _decode(self, key: str, payload: bytes | None, now_s: float) -> tuple[ReportedCells, str]:
        if key != self._key:
            # A wildcard addresses many vehicles at once, but an observation has one observer.
            raise RejectedReport(RejectReason.KEY, f"{key[:200]}, expected {self._key}")
        if payload is None:
            raise RejectedReport(
                RejectReason.OVERSIZE, f"more than {MAX_QUERY_BYTES} bytes: send several reports"
            )
        try:
            report = self._authentication.verify(key, payload)
        except BadMessage as error:
            raise RejectedReport(RejectReason.UNSIGNED, str(error)) from None
        # After the check: other senders must not use up the payload's rate.
        if not self._bucket.try_take(now_s):
            raise RejectedReport(RejectReason.TOO_FAST, f"the limit is {PER_S:g} reports a second")
        return sensor_reports.decode_report(report, self._grid, self._clock(), self._tolerance_s)

    def _refuse(self, bad: RejectedReport, now_s: float) -> ReportAnswer:
        reason, refused = bad.reason, self.counts.refused
        refused[reason.value] = refused.get(reason.value, 0) + 1
        why = excerpt(str(bad))
        before_s = self._refused_at_s.get(reason)
        self._refused_at_s[reason] = now_s
        if before_s is None or now_s - before_s > SHOWN_AGAIN_AFTER_S:
            self._say(f"a report of observations was refused ({sum(refused.values())} so far): {why}")
        return ReportAnswer(taken=False, why=why)
