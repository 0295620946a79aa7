"""The specification of a figure, the results that it reads, and the checks before the first mission."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from swarmctl.core.section import Section
from swarmctl.study.figures.measures import DERIVED, value_text

Value = str | bool | int | float
Names = Annotated[
    tuple[str, ...],
    BeforeValidator(lambda given: (given,) if isinstance(given, str) else tuple(given)),
    Field(min_length=1),
]


def factors_of(*names: str | None) -> set[str]:
    return {name for name in names if name is not None}


class Spec(Section):
    """The keys that all kinds of figures have."""

    kind: str
    name: str | None = Field(
        None, pattern=r"^[\w-]+$", description="Name of the files. Default: number and kind."
    )
    title: str = Field("", description="Heading in the report.")
    caption: str = Field("", description="Text before the caption that the report writes.")
    where: dict[str, Value] = Field({}, description="Factors with the only value that is drawn.")
    panels: str | None = Field(None, description="Factor with one small panel for each value.")
    over: Names | None = Field(None, description="Factors over whose values the figure takes means.")
    width: Literal["one", "two"] = Field("one", description="One column of print (88 mm) or two (180 mm).")

    def file_name(self, number: int) -> str:
        """Return the name of the figure's files without suffix; `number` counts the figures from 1."""
        return self.name or f"{number:02}-{self.kind}"

    def factors(self) -> set[str]:
        """Return the factors that the figure shows."""
        return factors_of(self.panels)

    def measures(self) -> set[str]:
        """Return the measures that the figure shows."""
        return set()

    def check(self, factors: Mapping[str, Sequence[object]]) -> None:
        """Raise ValueError for values that the factors do not have."""


class Study(msgspec.Struct, frozen=True, eq=False):
    """The content of a results folder."""

    table: pd.DataFrame
    factors: Mapping[str, Sequence[object]]
    """values of each factor, in order"""
    measures: Sequence[str]
    area: tuple[int, int]
    """rows and columns"""
    tracks: pd.DataFrame | None = None
    hostiles: pd.DataFrame | None = None

    @property
    def n_worlds(self) -> int:
        return int(self.table["seed"].nunique())

    def values(self, factor: str | None) -> Sequence[object]:
        """Return the values of a factor; one value without a factor."""
        return self.factors[factor] if factor is not None else (None,)

    def shown(self, spec: Spec, factor: str | None) -> Sequence[object]:
        """Return the values of a factor that the figure draws."""
        if factor is not None and factor in spec.where:
            return [value for value in self.values(factor) if same(value, spec.where[factor])]
        return self.values(factor)

    def groups(
        self, spec: Spec, axes: Sequence[str | None], table: pd.DataFrame | None = None
    ) -> tuple[NDArray[np.int64], tuple[int, ...]]:
        """Return the flat group index of each row, and the number of values of each axis."""
        rows = self.table if table is None else table
        shape = tuple(len(self.values(factor)) for factor in axes)
        index = np.zeros(len(rows), dtype=np.int64)
        for factor, n in zip(axes, shape, strict=True):
            index = index * n + (self.codes(factor, rows) if factor is not None else 0)
        for factor, wanted in spec.where.items():
            is_wanted = np.array([same(value, wanted) for value in self.values(factor)])
            index = np.where(is_wanted[self.codes(factor, rows)], index, -1)
        return index, shape

    def codes(self, factor: str, rows: pd.DataFrame) -> NDArray[np.int64]:
        """Return for each row the index of its value among the values of the factor."""
        order = {value_text(value): index for index, value in enumerate(self.factors[factor])}
        codes, uniques = pd.factorize(rows[factor])
        return np.array([order[value_text(value)] for value in uniques], dtype=np.int64)[codes]


class FigureKind(msgspec.Struct, frozen=True):
    """A kind of figure: one file, and one line in FIGURES."""

    spec: type[Spec]
    draw: Callable[[Study, Any], Figure]
    caption: Callable[[Study, Any], str]
    """says what is drawn, and how its intervals are made"""


def same(value: object, given: object) -> bool:
    """Return whether a value of a factor is the one that a figure names."""
    return value_text(value) == value_text(given)


def index_of(values: Sequence[object], given: object) -> int:
    return next(index for index, value in enumerate(values) if same(value, given))


def check_names(spec: Spec, factors: Mapping[str, Sequence[object]], measures: Collection[str]) -> None:
    """Raise ValueError for unknown names and values, and for a factor that the figure passes over."""
    over = set(spec.over or ())
    for factor in sorted({*spec.factors(), *spec.where, *over}):
        if factor not in factors:
            known = ", ".join(factors) or "none"
            raise ValueError(f"{factor!r} is no factor of this experiment; its factors are: {known}")
    for name in sorted(spec.measures()):
        if name not in measures and not (name in DERIVED and DERIVED[name] <= set(measures)):
            derived = [name for name, needed in DERIVED.items() if needed <= set(measures)]
            raise ValueError(f"{name!r} is no measure; the measures are: {', '.join([*measures, *derived])}")
    for factor, wanted in spec.where.items():
        require_value(factor, wanted, factors)
    for factor, values in factors.items():
        if len(values) > 1 and factor not in {*spec.factors(), *spec.where, *over}:
            text = (
                f"the factor {factor!r} has {len(values)} values, and the figure does not say which to draw; "
            )
            raise ValueError(f"{text}name it in `panels`, in `where`, or in `over` for means over all values")
    spec.check(factors)


def require_log_values(factor: str, values: Sequence[object]) -> None:
    """Raise ValueError if a logarithmic axis cannot show a number among the values of the factor."""
    for value in values:
        if isinstance(value, int | float) and not isinstance(value, bool) and value <= 0:
            text = f"a logarithmic axis cannot show {factor} = {value_text(value)}"
            raise ValueError(f"{text}; remove `x_scale`, or leave out the value")


def require_value(factor: str, wanted: object, factors: Mapping[str, Sequence[object]]) -> None:
    """Raise ValueError if the factor has no such value."""
    if not any(same(value, wanted) for value in factors[factor]):
        known = ", ".join(map(value_text, factors[factor]))
        raise ValueError(f"{factor} has no value {value_text(wanted)}; its values are: {known}")


def n_text(number: int) -> str:
    """Return a whole number with spaces between thousands."""
    return f"{number:,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def interval_text(study: Study, names: Sequence[str]) -> str:
    """Return the sentence on the intervals of these measures."""
    worlds = f"{n_text(study.n_worlds)} worlds"
    columns = study.table.columns
    is_share = [name in columns and study.table[name].dtype == bool for name in names]
    bootstrap = f"95 % intervals by bootstrap over {worlds}"
    wilson = f"95 % Wilson intervals over {worlds}, with the effective number of vehicles"
    if all(is_share):
        return f"{wilson}."
    return f"{bootstrap}; shares have {wilson}." if any(is_share) else f"{bootstrap}."
