"""The preflight conversation: set vehicles up as the configuration declares, and check them. Arms nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from swarmctl.agent.traffic.separation.conflicts import CrossingCounts, count_crossings
from swarmctl.agent.traffic.separation.trajectory import until_landing
from swarmctl.links.base import LinkError
from swarmctl.mavlink.procedures.fence import fence_items, put_fence
from swarmctl.preflight.checks import CHECKS, separation
from swarmctl.preflight.collection import FactCollector, VehicleToCheck
from swarmctl.preflight.facts import PreflightFacts, changes
from swarmctl.preflight.inspection import correct_parameters
from swarmctl.preflight.results import CheckResult
from swarmctl.preflight.waivers import Waiver

ATTEMPTS = 3
"""number of rounds of checks until a failure counts, because a lost message may cause a failure"""


class Preflight:
    """The checks of one run.

    sets_parameters: True if wrong parameters are written to the vehicles
    """

    def __init__(
        self,
        collector: FactCollector,
        waivers: Sequence[Waiver],
        *,
        say: Callable[[str], None],
        on_waived: Callable[[CheckResult], None],
        sets_parameters: bool,
    ) -> None:
        self.checked: dict[str, tuple[CheckResult, ...]] = {}
        """the last results of every vehicle, by name"""
        self.crossings: CrossingCounts | None = None
        """the numbers of pairs of first routes that come close over ground; None before the first checks"""
        self._waivers = waivers
        self._say = say
        self._on_waived = on_waived
        self._sets_parameters = sets_parameters
        self._collector = collector

    async def set_up(self, vehicle: VehicleToCheck) -> None:
        """Set parameters, if the configuration allows it, and upload the fence.

        Failures are reported to the operator; the checks find them again. Raises LinkError if the vehicle
        does not answer.
        """
        if self._sets_parameters:
            await self._correct_parameters(vehicle)
        items = fence_items(self._collector.fence_polygon)
        try:
            await vehicle.runner.link.ask("upload fence", partial(put_fence, items=items))
        except LinkError as error:
            self._say(f"{error}; the fence is not verified on the vehicle")

    async def _correct_parameters(self, vehicle: VehicleToCheck) -> None:
        required, _ = self._collector.required_parameters(vehicle)
        procedure, name = partial(correct_parameters, required=required), vehicle.spec.name
        done = await vehicle.runner.link.ask("set parameters", procedure)
        if done.failure:
            self._say(f"{name}: {done.failure}")
        if done.written:
            text = "parameters written permanently, as the configuration declares"
            self._say(f"{name}: {text}: {changes(done.written, done.found)}")

    async def failures(
        self, vehicles: Sequence[VehicleToCheck], everyone: Sequence[VehicleToCheck]
    ) -> list[str]:
        """Check `vehicles`, a subset of `everyone`; return a message for each result that does not pass."""
        await self._check_repeatedly(vehicles, everyone)
        for result in self._results(vehicles):
            if result.waived:
                text = f"found {result.finding.found}; wanted {result.finding.wanted}"
                self._say(f"{result.vehicle}: {result.check}: waived by the operator: {text} [waived]")
                self._on_waived(result)
        return [str(result) for result in self._results(vehicles) if not result.passes]

    async def early_failures(self, vehicle: VehicleToCheck, everyone: Sequence[VehicleToCheck]) -> list[str]:
        """Check one vehicle before all are ready; return its failures, without the check `separation`."""
        await self._check_repeatedly([vehicle], everyone)
        early = [result for result in self._results([vehicle]) if result.check != separation.NAME]
        return [str(result) for result in early if not result.passes]

    async def _check_repeatedly(
        self, vehicles: Sequence[VehicleToCheck], everyone: Sequence[VehicleToCheck]
    ) -> None:
        """Check all vehicles once, and vehicles with failures again, up to ATTEMPTS rounds."""
        failing = list(vehicles)
        for _ in range(ATTEMPTS):
            await self._check_all(failing, everyone)
            failing = [v for v in failing if not all(result.passes for result in self._results([v]))]
            if not failing:
                break

    def _results(self, vehicles: Sequence[VehicleToCheck]) -> list[CheckResult]:
        return [result for vehicle in vehicles for result in self.checked[vehicle.spec.name]]

    async def _check_all(
        self, vehicles: Sequence[VehicleToCheck], everyone: Sequence[VehicleToCheck]
    ) -> None:
        collected = await self._collector.collect(vehicles, everyone)
        trajectories = self._collector.trajectories.values()
        known = (until_landing(trajectory) for trajectory in trajectories if trajectory is not None)
        self.crossings = count_crossings(dict(enumerate(known)), self._collector.limits)
        for facts in collected:
            self.checked[facts.spec.name] = tuple(self._check(facts))

    def _check(self, facts: PreflightFacts) -> Iterable[CheckResult]:
        for check in CHECKS:
            finding = check.check(facts)
            waived = check.WAIVABLE and any(w.covers(check.NAME, facts.spec.name) for w in self._waivers)
            yield CheckResult(facts.spec.name, check.NAME, check.WAIVABLE, finding, waived and not finding.ok)
