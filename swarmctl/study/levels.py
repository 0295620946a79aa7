"""Levels of an experiment: every combination of the values of its factors. Pure."""

from __future__ import annotations

import itertools
import json
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import msgspec

from swarmctl.config.yaml_lines import KeyPath
from swarmctl.core.operator_text import did_you_mean

Scalar = bool | int | float | str
"""a value of a factor as results show it"""

OPERATORS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le, ">=": operator.ge, "==": operator.eq, "!=": operator.ne, "<": operator.lt,
    ">": operator.gt,
}  # fmt: skip
_CONDITION = re.compile(r"\s*(\S+)\s*(<=|>=|==|!=|<|>)\s*(\S+)\s*")
_PART = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


class Choice(msgspec.Struct, frozen=True):
    """One value of a factor: its label in the results, and the keys of the configuration that it sets."""

    label: Scalar
    changes: Mapping[str, Any]


class Factor(msgspec.Struct, frozen=True):
    """A column of the results, and its values in the order of the experiment file."""

    name: str
    choices: tuple[Choice, ...]

    @property
    def labels(self) -> tuple[Scalar, ...]:
        """The values of the column: all of one type, or text."""
        labels = [choice.label for choice in self.choices]
        kinds = {type(label) for label in labels}
        if kinds == {int, float}:
            return tuple(float(label) for label in labels)
        return tuple(labels) if len(kinds) == 1 else tuple(str(label) for label in labels)


class Level(msgspec.Struct, frozen=True):
    """One combination of values."""

    index: int
    values: Mapping[str, Scalar]
    """the label of each factor"""
    changes: Mapping[str, Any]
    """the keys of the configuration that the level sets"""

    def __str__(self) -> str:
        return ", ".join(f"{name} = {value}" for name, value in self.values.items()) or "the only level"


def label_of(value: Any) -> Scalar:
    """Return a value as results show it; a section or a list is shown as JSON."""
    return value if isinstance(value, Scalar) else json.dumps(value)


def levels_of(factors: Sequence[Factor], conditions: Sequence[str]) -> list[Level]:
    """Return the levels that fulfil all conditions, numbered from 0; the last factor changes fastest.

    Raises ValueError for a condition that cannot be evaluated.
    """
    tests = [_condition(text, factors) for text in conditions]
    found: list[Level] = []
    for combination in itertools.product(*(range(len(factor.choices)) for factor in factors)):
        chosen = list(zip(factors, combination, strict=True))
        raw = {factor.name: factor.choices[i].label for factor, i in chosen}
        if not all(test(raw) for test in tests):
            continue
        changes: dict[str, Any] = {}
        for factor, i in chosen:
            changes |= factor.choices[i].changes
        values = {factor.name: factor.labels[i] for factor, i in chosen}
        found.append(Level(len(found), values, changes))
    return found


def _condition(text: str, factors: Sequence[Factor]) -> Callable[[Mapping[str, Scalar]], bool]:
    match = _CONDITION.fullmatch(text)
    if match is None:
        raise ValueError(
            f"{text!r}: expected FACTOR OPERATOR VALUE, such as communication.range < simulate.count; the "
            f"operators are {' '.join(OPERATORS)}"
        )
    left, sign, right = match.groups()
    by_name = {factor.name: factor for factor in factors}
    if left not in by_name:
        raise ValueError(f"{text!r}: {left!r} is no factor; {suggestion(left, by_name)}")
    labels = {str(choice.label): choice.label for choice in by_name[left].choices}
    value = labels.get(right, _number(right))
    if right not in by_name and value is None:
        raise ValueError(f"{text!r}: {right!r} is neither a factor, nor a number, nor a value of {left}")

    def holds(level: Mapping[str, Scalar]) -> bool:
        a, b = level[left], level[right] if right in by_name else value
        try:
            return OPERATORS[sign](a, b)
        except TypeError:
            raise ValueError(f"{text!r}: {a!r} and {b!r} have no order; compare numbers") from None

    return holds


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def key_path(key: str) -> KeyPath:
    """Return the path of a dotted key, such as `vehicles[0].goal`. Raises ValueError for a malformed key."""
    parts = [(name, index) for name, index in _PART.findall(key)]
    path = tuple(name or int(index) for name, index in parts)
    if not path or "".join(f".{p}" if isinstance(p, str) else f"[{p}]" for p in path) != f".{key}":
        raise ValueError(f"{key!r} is malformed; expected a dotted key such as planner.w or vehicles[0].goal")
    return path


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return the advice for a word that is none of the known ones."""
    known = list(known)
    if hint := did_you_mean(word, known):
        return hint
    if len(known) <= 12:
        return f"expected {' or '.join(known)}"
    return "the page reference/configuration.md and `swarmctl schema` have all keys"


def with_value(data: Any, path: KeyPath, value: Any) -> Any:
    """Return the data of a configuration with another value of a key.

    Raises ValueError if the data have no section or list there.
    """
    if not path:
        return value
    part, rest = path[0], path[1:]
    if isinstance(part, int):
        if not isinstance(data, tuple) or part >= len(data):
            raise ValueError(f"the base configuration has no item [{part}] there")
        return (*data[:part], with_value(data[part], rest, value), *data[part + 1 :])
    if data is None:
        data = {}
    if not isinstance(data, dict):
        text = f"the base configuration has {data!r} instead of a section"
        raise ValueError(text)  # noqa: TRY004 - the file is wrong, not the program
    return data | {part: with_value(data.get(part), rest, value)}
