"""The resources of a flight, opened and closed: files, front end to the vehicles, bus, network."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path

import msgspec

from swarmctl.bus.authentication import Authentication
from swarmctl.bus.network import Network
from swarmctl.bus.transports import BUSES
from swarmctl.bus.transports.base import Transport
from swarmctl.bus.transports.subscriptions import ReportOnce
from swarmctl.config.links import Links
from swarmctl.flight.network import network_of
from swarmctl.flight.run import Run
from swarmctl.links.base import LinkError
from swarmctl.links.frontend import FrontEnd
from swarmctl.links.signing import Signing
from swarmctl.links.transports.memory import MemoryWire
from swarmctl.links.url import parse_url
from swarmctl.report.evidence.chain import Opened, sha256
from swarmctl.report.evidence.log import FILE_NAME, Evidence
from swarmctl.report.record import Recorder
from swarmctl.report.summary import FlightStatistics
from swarmctl.report.ui import UiObserver
from swarmctl.security.files import KeyringError
from swarmctl.security.mavlink_key import TimestampFile, read_mavlink_key
from swarmctl.security.requests import by_token
from swarmctl.security.token import new_token, token_of_environment


class Records(msgspec.Struct, frozen=True):
    """The observers of a flight."""

    recorder: Recorder
    statistics: FlightStatistics
    ui_observer: UiObserver
    evidence: Evidence

    @property
    def observers(self) -> tuple[Recorder, FlightStatistics, UiObserver, Evidence]:
        """The observers in the order in which they receive an event."""
        return (self.recorder, self.statistics, self.ui_observer, self.evidence)

    def note(self, uav: int, text: str) -> None:
        """Note a message that vehicle `uav` refused, or a report that contradicts its own observations."""
        now = asyncio.get_running_loop().time()
        for observer in self.observers:
            observer.noted(uav, text, now, to_operator=False)

    @property
    def trouble(self) -> tuple[str, ...]:
        return tuple(text for text in (self.recorder.trouble, self.evidence.trouble) if text)


@contextlib.contextmanager
def open_records(run: Run) -> Iterator[Records]:
    """Create the files of a run, and close them at the end. Raises OSError."""
    resumes = run.options.resumes
    # The record last: a run with a record can be continued, and that needs the evidence too.
    evidence = begin_evidence(run)
    earlier = None if resumes is None else resumes.stored
    recorder = Recorder(run.folder / "run.mcap", run.scenario, run.epoch_ns, earlier)
    if resumes is not None:
        resumes.note_continuation(run.folder.name)
    statistics = FlightStatistics() if resumes is None else resumes.statistics
    try:
        yield Records(recorder, statistics, UiObserver(run.ui, run.names), evidence)
    finally:
        recorder.close()
        evidence.close(run.options.signer)


def begin_evidence(run: Run) -> Evidence:
    """Open the evidence of a run in its folder. Raises OSError."""
    resumes = run.options.resumes
    opened = Opened(
        run=run.scenario.config.name,
        configuration_sha256=sha256(run.scenario.config.model_dump_json().encode()),
        clock=run.clock,
        vehicles={spec.name: spec.sysid for spec in run.scenario.specs},
        continues=None if resumes is None else resumes.evidence,
    )
    return Evidence(
        run.folder / FILE_NAME,
        opened,
        now=asyncio.get_running_loop().time,
        unix_s_at_zero=run.epoch_ns / 1e9,
        say=run.ui.say,
        waits_in_thread=run.clock == "real",
    )


class FlightResources(msgspec.Struct, frozen=True):
    """Open resources that all vehicles of a flight share."""

    front_end: FrontEnd
    wire: MemoryWire
    """the wire to the simulated vehicles of a run on the virtual clock"""
    transport: Transport
    network: Network
    token_authentication: Authentication | None
    """check of requests on a bus that this flight has opened; None for a bus that was already open"""


@contextlib.asynccontextmanager
async def open_resources(run: Run, bus: Transport | None, records: Records) -> AsyncIterator[FlightResources]:
    """Open the resources of a flight; close them at the end, except `bus`, an already open bus."""
    loop, links, say = asyncio.get_running_loop(), run.scenario.config.links, run.ui.say

    def wall_time_us() -> int:
        return (run.epoch_ns + round(loop.time() * 1e9)) // 1000

    def report(text: str) -> None:
        if text:
            say(text)
            records.evidence.remark(text)

    async with contextlib.AsyncExitStack() as stack:
        pool = ThreadPoolExecutor(1, "timestamps") if run.clock == "real" else None
        if pool is not None:
            # The shutdown does not wait: a disk that hangs must not delay the reports.
            stack.callback(pool.shutdown, wait=False)
        wire = MemoryWire()
        front_end = await stack.enter_async_context(
            FrontEnd(
                wall_time_us=wall_time_us,
                memory={"fleet": wire},
                evidence=records.evidence,
                signing=_signing(links, pool),
                say=report,
            )
        )
        stack.callback(lambda: report(front_end.refusal_summary))
        for receiver in links.forward:
            await front_end.forward(parse_url(receiver), commands=links.forward_commands)
        if run.simulated:  # before the simulator starts, so that a port in use is reported at once
            await front_end.open(run.endpoint(run.simulated[0]))
        communication = run.scenario.config.communication
        authentication: Authentication | None = None
        if bus is None:
            name, kind = run.scenario.config.name, BUSES[communication.bus]
            if run.clock == "virtual" and kind.is_networked:
                kind = BUSES["memory"]
            token = ""
            if kind.is_networked:
                secret = token_of_environment() or new_token()
                token = secret.text
                authentication = by_token(name, secret, communication.clock_tolerance_s, time.time)
            uavs, failed = tuple(run.names), ReportOnce(say)
            opened = kind.open(name, uavs, communication.listen, token, say, on_failure=failed)
            bus = stack.enter_context(opened)
        network = network_of(run.scenario, bus, run.times, run.options.frame_codec, records.note)
        stack.callback(network.close)
        yield FlightResources(front_end, wire, bus, network, authentication)


def _signing(links: Links, pool: Executor | None) -> Signing | None:
    """Return the MAVLink signing of the links; None without a key. `pool` writes the timestamps to the disk.

    Raises LinkError if the key or its timestamps cannot be used.
    """
    if links.signing_key is None:
        return None
    file = Path(links.signing_key)
    try:
        return Signing(read_mavlink_key(file), TimestampFile(file), links.signing_link_id, pool)
    except (KeyringError, OSError, ValueError) as error:
        raise LinkError(f"links.signing_key: {error}") from error
