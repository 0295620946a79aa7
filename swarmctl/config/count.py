"""How many hostiles there are, in a configuration: a number, or a distribution of it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from swarmctl.core.section import Section


class Poisson(Section):
    """So many hostiles on average, independently of each other."""

    distribution: Literal["poisson"]
    mean: float = Field(gt=0.0, description="expected number of hostiles")


class Binomial(Section):
    """Each of so many hostiles is there with probability p."""

    distribution: Literal["binomial"]
    trials: int = Field(ge=1, description="hostiles there may be at most")
    p: float = Field(ge=0.0, le=1.0, description="chance that each of them is there")


class Uniform(Section):
    """Every number in a range is as likely as any other."""

    distribution: Literal["uniform"]
    min: int = Field(ge=0, description="least number of hostiles")
    max: int = Field(ge=0, description="greatest number of hostiles")

    def model_post_init(self, _context: object) -> None:
        if self.min > self.max:
            raise ValueError(f"min {self.min} exceeds max {self.max}; exchange them")


class Weights(Section):
    """Some numbers, each with its weight."""

    distribution: Literal["weights"]
    weights: dict[Annotated[int, Field(ge=0)], Annotated[float, Field(ge=0.0)]] = Field(
        description="number of hostiles: its weight; weights need not add up to 1"
    )

    def model_post_init(self, _context: object) -> None:
        if not any(weight > 0.0 for weight in self.weights.values()):
            raise ValueError("no number of hostiles has a weight above 0, such as {20: 1, 24: 3}")


DISTRIBUTIONS: dict[str, type[Poisson | Binomial | Uniform | Weights]] = {
    "poisson": Poisson,
    "binomial": Binomial,
    "uniform": Uniform,
    "weights": Weights,
}


def _count_tag(value: Any) -> str | None:
    """By what `threats.count` is read: as a number, or as the distribution it names."""
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
        custom_error_message="expected a number of hostiles, or a distribution of it: "
        f"{{distribution: {' | '.join(DISTRIBUTIONS)}, ...}}",
    ),
]
