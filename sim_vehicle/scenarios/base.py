"""Types and base classes for the sections of a scenario."""

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import CoreSchema, core_schema

Latitude = Annotated[float, Field(strict=True, ge=-89, le=89)]  # deg; near a pole longitudes converge
Longitude = Annotated[float, Field(strict=True, ge=-180, le=180)]  # deg
Heading = Annotated[float, Field(strict=True, ge=0, le=360)]  # deg, clockwise from north
Altitude = Annotated[float, Field(strict=True, ge=-500, le=9000)]  # m above mean sea level
Probability = Annotated[float, Field(strict=True, ge=0, le=1)]
Metres = Annotated[float, Field(strict=True, ge=-100_000, le=100_000)]  # coordinate [m]
Length = Annotated[float, Field(strict=True, gt=0, le=100_000)]  # m
Seconds = Annotated[float, Field(strict=True, ge=0, le=1e6)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
SystemId = Annotated[int, Field(strict=True, ge=1, le=250)]


class NameIn:
    """An annotation that restricts a text to the names of a registry, as Literal does."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = list(names)

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        return core_schema.literal_schema(self._names)


class Section(BaseModel):
    """An immutable section of a scenario; unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class NoSettings(Section):
    """A key without settings."""


class OneOf(Section):
    """A section with exactly one choice; the fields of `common()` may accompany the choice.

    A bare name has empty settings: `rtl` means `rtl: {}`.
    """

    @classmethod
    def common(cls) -> frozenset[str]:
        """Return the fields that may accompany each choice."""
        return frozenset()

    @classmethod
    def choices(cls) -> list[str]:
        return [name for name in cls.model_fields if name not in cls.common()]

    @model_validator(mode="before")
    @classmethod
    def _from_short_form(cls, data: Any) -> Any:
        if isinstance(data, str):
            data = {data: {}}
        if not isinstance(data, dict):
            return data
        filled = {key: value for key, value in data.items() if value is not None}
        if not filled.keys() & set(cls.choices()):  # `rtl:` without settings
            filled = {key: {} if value is None else value for key, value in data.items()}
        unknown = [key for key in filled if key not in cls.model_fields]
        found = [key for key in filled if key in cls.choices()]
        if not unknown and len(found) != 1:
            names = " and ".join(found) or "none"
            raise ValueError(f"needs exactly one of {', '.join(cls.choices())}, found {names}")
        return filled

    @property
    def chosen(self) -> str:
        """Return the name of the chosen field."""
        return next(name for name in self.choices() if getattr(self, name) is not None)
