"""Procedures of preflight on a vehicle on the ground: correct parameters, request the facts for checks. Pure.

Nothing here arms a vehicle.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec

from swarmctl.mavlink.procedures.fence import enable_fence, read_fence
from swarmctl.mavlink.procedures.rally import count_rally_points
from swarmctl.mavlink.protocol.mission_download import DownloadOutcome
from swarmctl.mavlink.protocol.parameters import read_parameters, set_parameters
from swarmctl.mavlink.protocol.procedure import Context, Procedure
from swarmctl.mavlink.telemetry.instruments import read_instruments
from swarmctl.preflight.facts import Answers
from swarmctl.preflight.policy.required import RequiredParameter, corrections

FENCE_SELECTION = frozenset({"FENCE_ENABLE", "FENCE_TYPE"})


class Corrected(msgspec.Struct, frozen=True):
    """Result of a correction of parameters. The checks find its failure again."""

    found: Mapping[str, float]
    """reported values of the required parameters, by name"""
    written: Mapping[str, float]
    """corrected values, by name"""
    failure: str = ""


def correct_parameters(ctx: Context, required: Sequence[RequiredParameter]) -> Procedure[Corrected]:
    """Write the required parameters whose reported values are not accepted."""
    found = yield from _values(ctx, required)
    written = corrections(required, found)
    if written and (failure := (yield from set_parameters(ctx, written)).failure):
        return Corrected(found, {}, f"the parameters are not all set: {failure}")
    return Corrected(found, written)


def inspect(ctx: Context, required: Sequence[RequiredParameter]) -> Procedure[Answers]:
    """Ask for instruments, parameters, rally points and fence; make an ArduPilot enforce its fence.

    The fence is not enabled if its parameters are wrong.
    """
    failures, fence_failure = [], ""
    instruments = yield from read_instruments(ctx)
    parameters = yield from _values(ctx, required)
    selection = [r for r in required if r.name in FENCE_SELECTION]
    is_selected = bool(selection) and all(r.met_by(parameters) for r in selection)
    if is_selected and (failure := (yield from enable_fence(ctx)).failure):
        fence_failure = f"the fence is not confirmed as enabled: {failure}"
    rally = yield from count_rally_points(ctx)
    if rally.count is None:
        failures.append(f"the number of rally points is unknown: {rally.failure}")
    fence = yield from read_fence(ctx)
    is_read = fence.outcome is DownloadOutcome.COMPLETE
    if not is_read:
        failures.append(f"the fence cannot be read: {fence.text}")
    items = fence.items if is_read else None
    return Answers(instruments, parameters, items, fence_failure, rally.count, tuple(failures))


def _values(ctx: Context, required: Iterable[RequiredParameter]) -> Procedure[dict[str, float]]:
    """Return the reported values of parameters, by name."""
    found = yield from read_parameters(ctx, [r.name for r in required])
    return {name: parameter.value for name, parameter in found.items()}
