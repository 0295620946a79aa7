"""The schema of an experiment file. `experiment_checks` checks its values, `experiment` loads it."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from swarmctl.core.section import NameIn, Section
from swarmctl.study.kinds import KINDS


class Steps(Section):
    """Evenly spaced values of a factor."""

    first: float = Field(alias="from", description="First value.")
    to: float = Field(description="Last value.")
    steps: int = Field(ge=2, description="Number of values, with both ends.")

    @property
    def values(self) -> tuple[float, ...]:
        """The values: whole numbers if both ends and all values are whole."""
        first, last = self.first, self.to
        values = [round(first + (last - first) * i / (self.steps - 1), 12) for i in range(self.steps)]
        if all(value == int(value) for value in values):
            return tuple(map(int, values))
        return tuple(values)


class Until(Section):
    """The precision at which the experiment ends."""

    measure: str = Field(description="Measure whose mean is to be known, such as strikes.")
    half_width: float = Field(
        gt=0.0, description="Half the width of the 95 % interval of the mean, reached at every level."
    )
    block: int = Field(
        100, ge=2, description="Number of worlds between two decisions; the last block ends at `worlds`."
    )


class ExperimentFile(Section):
    """An experiment: a configuration, factors, worlds and figures."""

    question: str = Field(min_length=1, description="The question that the experiment answers, a sentence.")
    base: str = Field(description="Configuration that all levels begin with, relative to this file.")
    kind: Annotated[str, NameIn(KINDS)] = Field(
        "missions", description=f"What is computed for each level and seed: {', '.join(KINDS)}."
    )
    set: dict[str, Any] = Field(
        {}, description="Fixed changes of the base: dotted keys with values, such as {planner.w: 0.7}."
    )
    factors: dict[str, Steps | tuple[Any, ...]] = Field(
        {},
        description="Factors; each combination of their values is a level. A dotted key of the base, with a "
        "list of values or {from: 0, to: 1, steps: 21}. Or any other name, with a list of {name: LABEL, KEY: "
        "VALUE, …}, whose keys change together.",
    )
    where: tuple[str, ...] = Field(
        (),
        description="Conditions of a level, such as communication.range < simulate.count. The experiment "
        "leaves out all other combinations.",
    )
    worlds: int = Field(
        1000,
        ge=1,
        description="Number of seeds at each level; with `until` their greatest number. A seed is one world: "
        "equal hostiles and equal draws at all levels.",
    )
    first_seed: int = Field(0, ge=0, description="First seed.")
    until: Until | None = Field(
        None, description="Precision at which the experiment ends. Default: after all worlds."
    )
    tracks: tuple[Annotated[int, Field(ge=0)], ...] = Field(
        (), description="Seeds whose flown cells and hostiles are kept, for figures of tracks."
    )
    search: dict[str, Any] | None = Field(
        None, description="Settings of the kind `routes`. Other kinds have none."
    )
    figures: tuple[dict[str, Any], ...] = Field((), description="Figures: each has a kind and its keys.")
