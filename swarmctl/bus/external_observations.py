"""Where a vehicle's payload reports what it sees: one key a vehicle, for puts and for questions.

A payload puts and forgets, or asks and is told what became of its report (`swarmctl.bus.sensor_reports` has both).
What is taken goes to the vehicle's agent as its own look, whatever the vehicle is doing: on the ground and
after its flight, too, for what it saw is as true for the others, and a person who reports by hand may know it
from elsewhere. All else is refused as a whole and counted, and each reason is said once until there was a
pause.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from swarmctl.bus import keys, sensor_reports
from swarmctl.bus.rate import TokenBucket
from swarmctl.bus.sensor_reports import RejectedReport, RejectReason, Report, ReportAnswer, ReportedCells
from swarmctl.bus.transports.base import MAX_QUESTION_BYTES, Reply, Transport
from swarmctl.core.grid import Grid
from swarmctl.core.texts import printable

PER_S = 50.0
BURST = 50
"""Reports to one vehicle, good or bad: so many at once, and so many a second in the long run."""
PAUSE_S = 10.0
"""without a refusal for the same reason: the next one is said again"""
MAX_WHY = 400
TIMEOUT_S = 3.0
"""for an answer: a report is taken or refused as soon as it is read"""


@dataclass(slots=True)
class ReportCounts:
    """How many reports came."""

    taken: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    """by reason"""


class ReportReceiver:
    """One vehicle's inlet, open from its making until the transport is closed.

    `clock` is the wall clock [s since 1970], by which reports may not be too old or of the future; `post`
    gets the cells of a report and its source.
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
    ) -> None:
        self.counts = ReportCounts()
        self._key = keys.sensor_report(swarm, uav)
        self._grid = grid
        self._clock = clock
        self._post = post
        self._say = say
        self._tolerance_s = tolerance_s
        self._pace = TokenBucket(PER_S, BURST)
        self._refused_at_s: dict[RejectReason, float] = {}
        transport.subscribe(self._key, self._put)
        transport.serve(self._key, self._asked)

    def _put(self, key: str, payload: bytes) -> None:
        self._take(key, payload)

    def _asked(self, key: str, payload: bytes | None, reply: Reply) -> None:
        answer = self._take(key, payload)
        if key == self._key:
            reply(sensor_reports.encode(answer))

    def _take(self, key: str, payload: bytes | None) -> ReportAnswer:
        """A payload that was too long to be read is None."""
        now_s = asyncio.get_running_loop().time()
        try:
            cells, source = self._read(key, payload, now_s)
        except RejectedReport as bad:
            return self._refuse(bad, now_s)
        self.counts.taken += 1
        self._post(cells, source)
        return ReportAnswer(taken=True, cells=cells)

    def _read(self, key: str, payload: bytes | None, now_s: float) -> tuple[ReportedCells, str]:
        """Raises BadReport."""
        if not self._pace.try_take(now_s):
            raise RejectedReport(RejectReason.TOO_FAST, f"expected at most {PER_S:g} reports a second")
        if key != self._key:
            # A wildcard means many vehicles at once: what one payload sees is not what all see.
            raise RejectedReport(RejectReason.KEY, f"{key[:200]}, expected {self._key}")
        if payload is None:
            raise RejectedReport(
                RejectReason.OVERSIZE, f"more than {MAX_QUESTION_BYTES} bytes: send several reports"
            )
        return sensor_reports.decode_report(payload, self._grid, self._clock(), self._tolerance_s)

    def _refuse(self, bad: RejectedReport, now_s: float) -> ReportAnswer:
        reason, refused = bad.reason, self.counts.refused
        refused[reason.value] = refused.get(reason.value, 0) + 1
        # It may quote the sender, and is shown on a terminal.
        why = printable(str(bad)[:MAX_WHY])
        before_s = self._refused_at_s.get(reason)
        self._refused_at_s[reason] = now_s
        if before_s is None or now_s - before_s > PAUSE_S:
            self._say(f"a payload's report was refused ({sum(refused.values())} so far): {why}")
        return ReportAnswer(taken=False, why=why)


async def send_report(bus: Transport, swarm: str, uav: int, report: Report) -> ReportAnswer | None:
    """Report, and hear what became of it; None where nobody takes reports for this vehicle.

    Raises TimeoutError, and ValueError where the answer cannot be understood.
    """
    answers = await bus.ask(keys.sensor_report(swarm, uav), sensor_reports.encode(report), TIMEOUT_S)
    return sensor_reports.decode_answer(answers[0]) if answers else None
