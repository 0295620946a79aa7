"""The section `threats` of a configuration: hostiles, their number, and their firing strength."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from swarmctl.core.grid import Cell
from swarmctl.core.section import Section
from swarmctl.core.threat import FiringStrength


class Poisson(Section):
    """A Poisson distribution of the number of hostiles."""

    distribution: Literal["poisson"] = Field(description="poisson")
    mean: float = Field(gt=0.0, description="Mean number of hostiles.")


class Binomial(Section):
    """A binomial distribution: each of `trials` hostiles is present with probability `p`."""

    distribution: Literal["binomial"] = Field(description="binomial")
    trials: int = Field(ge=1, description="Greatest number of hostiles.")
    p: float = Field(ge=0.0, le=1.0, description="Probability that a hostile is present.")


class Uniform(Section):
    """A uniform distribution from `min` to `max`, both included."""

    distribution: Literal["uniform"] = Field(description="uniform")
    min: int = Field(ge=0, description="Least number of hostiles.")
    max: int = Field(ge=0, description="Greatest number of hostiles.")

    def model_post_init(self, _context: object) -> None:
        if self.min > self.max:
            raise ValueError(f"min {self.min} exceeds max {self.max}; swap them")


class Weights(Section):
    """A distribution by a weight for each number of hostiles."""

    distribution: Literal["weights"] = Field(description="weights")
    weights: dict[Annotated[int, Field(ge=0)], Annotated[float, Field(ge=0.0)]] = Field(
        description="Weight of each number of hostiles, such as {20: 1, 24: 3}. Weights need not add up to 1."
    )

    def model_post_init(self, _context: object) -> None:
        if not any(weight > 0.0 for weight in self.weights.values()):
            raise ValueError("no number of hostiles has a weight above 0; give one, such as {20: 1, 24: 3}")


DISTRIBUTIONS: dict[str, type[Poisson | Binomial | Uniform | Weights]] = {
    "poisson": Poisson,
    "binomial": Binomial,
    "uniform": Uniform,
    "weights": Weights,
}


def _count_tag(value: Any) -> str | None:
    """Return the form of `threats.count`: a number, or the name of a distribution."""
    if not isinstance(value, (dict, Section)):
        return "number"
    name = value.get("distribution") if isinstance(value, dict) else getattr(value, "distribution", None)
    return name if isinstance(name, str) and name in DISTRIBUTIONS else None


Count = Annotated[
    Annotated[int, Field(ge=0), Tag("number")]
    | Annotated[Poisson, Tag("poisson")]
    | Annotated[Binomial, Tag("binomial")]
    | Annotated[Uniform, Tag("uniform")]
    | Annotated[Weights, Tag("weights")],
    Discriminator(
        _count_tag,
        custom_error_type="distribution",
        custom_error_message="expected a number of hostiles or a distribution: "
        f"{{distribution: {' | '.join(DISTRIBUTIONS)}, ...}}",
    ),
]


class Drawn(Section):
    """True cells of the hostiles, drawn with the seed: over the whole area, or in clusters.

    The beliefs of the vehicles know of neither: they assume `threats.count` hostiles anywhere in the area.
    """

    count: int | None = Field(
        None, ge=0, description="True number of hostiles. Default: drawn by `threats.count`."
    )
    clusters: int | None = Field(
        None, ge=1, description="Number of clusters. Default: the hostiles are anywhere in the area."
    )
    spread_cells: float | None = Field(
        None,
        gt=0.0,
        description="Standard deviation of the distance from a cluster's centre, north and east [cells].",
    )

    def model_post_init(self, _context: object) -> None:
        if (self.clusters is None) != (self.spread_cells is None):
            raise ValueError("clusters and spread_cells belong together; give both or neither")


def _hostiles_tag(value: Any) -> str:
    """Return the form of `threats.hostiles`: cells, a section, or the word random."""
    if isinstance(value, (dict, Section)):
        return "drawn"
    return "cells" if isinstance(value, (list, tuple)) else "random"


Hostiles = Annotated[
    Annotated[Literal["random"], Tag("random")]
    | Annotated[tuple[Cell, ...], Tag("cells")]
    | Annotated[Drawn, Tag("drawn")],
    Discriminator(_hostiles_tag),
]


class Strength(Section):
    """Probability that a hostile hits a vehicle, by the vehicle's cell (Eq. 1)."""

    direct: float = Field(description="Probability of a hit over the hostile's own cell.")
    first_neighbour: float = Field(description="Probability of a hit over one of the 4 adjacent cells.")
    second_neighbour: float = Field(description="Probability of a hit over one of the 4 diagonal cells.")

    def model_post_init(self, _context: object) -> None:
        FiringStrength(self.direct, self.first_neighbour, self.second_neighbour)


class Threats(Section):
    """The hostiles in the area. Agents never read `hostiles`, the true cells."""

    count: Count = Field(
        description="Announced number of hostiles (n_HA): a number, or its prior distribution."
    )
    firing_strength: Strength = Field(
        Strength(direct=0.6, first_neighbour=0.3, second_neighbour=0.1),
        description="Probability that a hostile hits a vehicle (Eq. 1).",
    )
    hostiles: Hostiles = Field(
        "random",
        description="True cells [row, col] of the hostiles; or random: drawn with the seed, by `count`; or a "
        "section: drawn in clusters, or in another number than announced.",
    )
