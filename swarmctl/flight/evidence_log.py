"""The evidence of one run: its first entry, and the signer of the last entry."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from swarmctl import __version__
from swarmctl.bus.transports.access import OPERATOR
from swarmctl.config.scenario import Scenario
from swarmctl.flight.wiring import Clock, epoch_ns
from swarmctl.report.evidence.chain import FORMAT, sha256
from swarmctl.report.evidence.file import FILE_NAME, EvidenceFile
from swarmctl.report.evidence.hooks import Evidence
from swarmctl.report.unfinished_run import UnfinishedRun
from swarmctl.security.evidence_keys import EvidenceSigner, load_evidence_signer


def begin(
    scenario: Scenario,
    folder: Path,
    clock: Clock,
    say: Callable[[str], None],
    resumes: UnfinishedRun | None = None,
) -> Evidence:
    """Open the evidence file of a run in its folder, in a running loop. Raises OSError."""
    loop = asyncio.get_running_loop()
    began_s, epoch_s = loop.time(), epoch_ns(clock) / 1e9
    config = scenario.config
    opened = {
        "format": FORMAT,
        "run": config.name,
        "program": f"swarmctl {__version__}",
        "configuration_sha256": sha256(config.model_dump_json().encode()),
        "clock": clock,
        "vehicles": {spec.name: spec.sysid for spec in scenario.specs},
        **({} if resumes is None else {"continues": resumes.evidence_summary}),
    }
    file = EvidenceFile(
        folder / FILE_NAME,
        opened,
        unix_s=lambda: epoch_s + loop.time(),
        run_s=lambda: loop.time() - began_s,
        say=say,
        in_thread=clock == "real",
    )
    return Evidence(file, {spec.sysid: spec.name for spec in scenario.specs})


def operator_evidence_signer(scenario: Scenario) -> EvidenceSigner | None:
    """Return the operator's signer; None if the configured folder of keys has no key of the operator.

    Raises KeyringError if the key exists and cannot be used.
    """
    keys = scenario.config.communication.keys
    if keys is None or not (Path(keys) / OPERATOR / "sign.pem").exists():
        return None
    return load_evidence_signer(Path(keys), OPERATOR)
