"""Changed copies of records, against those of the standard library."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from swarmctl.core.records import replace


@dataclasses.dataclass(frozen=True)
class Plain:
    a: int = 1
    b: str = "b"


@dataclasses.dataclass(frozen=True, slots=True)
class Slotted:
    a: int = 1
    b: str = "b"


@dataclasses.dataclass(frozen=True)
class Checked(Plain):
    def __post_init__(self) -> None:
        if self.a < 0:
            raise ValueError("below 0")


@pytest.mark.parametrize("kind", [Plain, Slotted, Checked])
def test_a_copy_has_the_changes_and_nothing_else(kind: type[Any]) -> None:
    record = kind()
    assert replace(record, a=2) == dataclasses.replace(record, a=2) == kind(a=2)
    assert record == kind()
    with pytest.raises(dataclasses.FrozenInstanceError):
        replace(record, a=2).a = 3
    with pytest.raises(TypeError):
        replace(record, c=2)


def test_a_check_of_the_record_holds_for_its_copies() -> None:
    with pytest.raises(ValueError, match="below 0"):
        replace(Checked(), a=-1)
