"""The checks of a scenario during a run, with the time and measured value of each failure."""

from dataclasses import dataclass

import numpy as np

from sim_vehicle.epoch import EPSILON_S
from sim_vehicle.scenarios.checks import CHECKS, Measured, RunView
from sim_vehicle.scenarios.model import Scenario
from sim_vehicle.scenarios.steps import CheckSpec


@dataclass(frozen=True, slots=True)
class CheckFailure:
    """The failure of one check for one vehicle."""

    check: str  # name, argument, times and vehicles
    sysid: int
    link: int  # number of the vehicle's link
    t_s: float
    found: str  # measured value

    def __str__(self) -> str:
        return f"t={self.t_s:.2f} s, vehicle {self.sysid}: {self.check}: failed, found {self.found}"


class RunningCheck:
    """One check during a run, with at most one failure for each vehicle."""

    def __init__(self, spec: CheckSpec, scenario: Scenario) -> None:
        self.name, self.argument, self.settings = spec.chosen, spec.argument, spec.settings
        self.failures: list[CheckFailure] = []
        self._check = CHECKS[spec.chosen]
        self._vehicles = [(v.sysid, v.link) for v in scenario.vehicles]
        self._selected = np.array(
            [spec.vehicles is None or v.sysid in spec.vehicles for v in scenario.vehicles]
        )
        self._undecided = self._selected.copy()
        self._closed = self._evaluated = False
        self._nearest_m = np.full(len(self._selected), np.inf)
        self._nearest_s = np.zeros(len(self._selected))

    def is_settled(self, now: float) -> bool:
        """Return True if the run need not go on for this check."""
        if self.settings.when == "eventually":
            return self._closed or not self._undecided.any()
        return now >= (self.settings.until_s or self.settings.from_s)

    @property
    def description(self) -> str:
        """Return the check as one line of text."""
        spec, value = self.settings, self.argument
        argument = "" if value is None else f" {value:g}" if isinstance(value, float) else f" {value}"
        description = [self.name + argument]
        if spec.when != self._check.when:
            description.append(spec.when)
        for name, time_s in (("from", spec.from_s or None), ("until", spec.until_s), ("by", spec.by_s)):
            if time_s is not None:
                description.append(f"{name} {time_s:g} s")
        if spec.vehicles is not None:
            description.append(
                f"vehicle{'s' if len(spec.vehicles) > 1 else ''} {', '.join(map(str, spec.vehicles))}"
            )
        return ", ".join(description)

    def observe(self, view: RunView) -> list[CheckFailure]:
        """Evaluate the check at this step and return new failures."""
        spec = self.settings
        if self._closed or spec.when == "end" or view.now + EPSILON_S < spec.from_s:
            return []
        if spec.until_s is not None and view.now > spec.until_s + EPSILON_S:
            return self._close(view) if spec.when == "eventually" else []
        holds, found = self._check.function(view, self.argument)
        self._evaluated = True
        self._note_nearest(view)
        if spec.when == "always":
            return self._fail(self._undecided & ~holds, view, found)
        self._undecided &= ~holds
        if spec.by_s is not None and view.now + EPSILON_S >= spec.by_s:
            return self._close(view)
        return []

    def end(self, view: RunView) -> list[CheckFailure]:
        """Return the failures that are known only at the end of the run."""
        if self._closed:
            return []
        if self.settings.when == "always":
            # A check fails if the run ended before `from_s`, or if no step was between the check's times.
            unseen = ["no step of the run between the check's times [not-evaluated]"] * len(self._selected)
            return [] if self._evaluated else self._fail(self._undecided.copy(), view, unseen)
        if self.settings.when == "end":
            holds, _ = self._check.function(view, self.argument)
            self._undecided &= ~holds
        return self._close(view)

    def _close(self, view: RunView) -> list[CheckFailure]:
        self._closed = True
        _, found = self._check.function(view, self.argument)
        return self._fail(self._undecided.copy(), view, self._at_closest_approach(found))

    def _note_nearest(self, view: RunView) -> None:
        if self._check.away_m is not None:
            away_m = self._check.away_m(view)
            nearer = away_m < self._nearest_m
            self._nearest_m[nearer], self._nearest_s[nearer] = away_m[nearer], view.now

    def _at_closest_approach(self, found: Measured) -> Measured:
        """Return each vehicle's smallest distance to the checked place and its time, as text.

        Without a finite distance, return the vehicle's text from `found`.
        """
        if self.settings.when != "eventually":
            return found
        return [
            f"{away_m:.4g} m away at the closest approach, at {self._nearest_s[i]:.2f} s"
            if np.isfinite(away_m)
            else self._found_text(found, i)
            for i, away_m in enumerate(self._nearest_m)
        ]

    def _fail(self, failed: np.ndarray, view: RunView, found: Measured) -> list[CheckFailure]:
        self._undecided &= ~failed
        added = [
            CheckFailure(self.description, *self._vehicles[i], view.now, self._found_text(found, i))
            for i in np.flatnonzero(failed).tolist()
        ]
        self.failures += added
        return added

    def _found_text(self, found: Measured, index: int) -> str:
        value = found[index]
        return value if isinstance(value, str) else f"{float(value):.4g} {self._check.unit}".strip()
