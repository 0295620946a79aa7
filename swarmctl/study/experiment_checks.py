"""Checks of an experiment file: its factors, and the configuration of each level. Pure."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import msgspec
from pydantic import ValidationError

from swarmctl.config.checks import check_config
from swarmctl.config.model import Config, schema_problems, validate
from swarmctl.config.problems import ConfigProblem, dotted
from swarmctl.config.scenario import build
from swarmctl.config.yaml_lines import KeyPath, touches
from swarmctl.core.section import Section
from swarmctl.study.experiment_file import ExperimentFile, Steps
from swarmctl.study.kinds import KINDS, Kind
from swarmctl.study.levels import (
    Choice,
    Factor,
    Level,
    key_path,
    label_of,
    suggestion,
    with_value,
)
from swarmctl.study.tables import KEY_COLUMNS

SETTINGS = "search"
"""the section of the settings of a kind, and the first part of their dotted keys"""


class Setup(msgspec.Struct, frozen=True):
    """The computation of one level: its configuration, and the settings of its kind."""

    config: Config
    settings: Section | None
    n_vehicles: int


def sections_of(kind: Kind) -> list[str]:
    """Return the first parts of the dotted keys of an experiment; the schema of a level checks the rest."""
    return [*Config.model_fields, *([] if kind.settings is None else [SETTINGS])]


def check_file(section: ExperimentFile, worlds: int) -> Iterator[ConfigProblem]:
    """Yield the problems of a file besides its factors."""
    kind = KINDS[section.kind]
    if kind.settings is None and section.search is not None:
        text = f"the kind {section.kind} has no settings; remove this section, or choose another kind"
        yield ConfigProblem((SETTINGS,), text)
    yield from _check_keys(section.set, ("set",), sections_of(kind))
    if (until := section.until) is not None and until.measure not in kind.measures:
        text = f"{until.measure!r} is no measure; {suggestion(until.measure, kind.measures)}"
        yield ConfigProblem(("until", "measure"), text)
    seeds = range(section.first_seed, section.first_seed + worlds)
    for i, seed in enumerate(section.tracks):
        if seed not in seeds:
            yield ConfigProblem(("tracks", i), f"the seeds are {seeds[0]} to {seeds[-1]}; give one of them")


def factors_of(section: ExperimentFile) -> tuple[list[Factor], list[ConfigProblem]]:
    """Return the factors of a file without those that are wrong, and the problems of the latter."""
    kind = KINDS[section.kind]
    sections = sections_of(kind)
    factors: list[Factor] = []
    problems: list[ConfigProblem] = []
    for name, values in section.factors.items():
        if wrong := list(_check_factor(name, values, sections)):
            problems += wrong
        elif name in (*KEY_COLUMNS, *kind.measures):
            text = f"{name} is a column of the results; choose another name"
            problems.append(ConfigProblem(("factors", name), text))
        else:
            factors.append(_factor(name, values, sections))
    return factors, problems + list(_check_overlap(section, factors))


def _check_factor(
    name: str, values: Steps | tuple[Any, ...], sections: Collection[str]
) -> Iterator[ConfigProblem]:
    here: KeyPath = ("factors", name)
    if not values:
        yield ConfigProblem(here, "the factor has no value; give a list, such as [0, 0.5, 1]")
    elif _is_key(name, sections):
        yield from _check_keys([name], ("factors",), sections)
    elif isinstance(values, tuple) and all(isinstance(v, dict) and "name" in v for v in values):
        for i, item in enumerate(values):
            yield from _check_keys([key for key in item if key != "name"], (*here, i), sections)
    else:
        text = f"{_no_key(name, sections)}; only a list of {{name: LABEL, KEY: VALUE}} may have another name"
        yield ConfigProblem(here, text)


def _is_key(name: str, sections: Collection[str]) -> bool:
    """Return whether a name begins with a section of the configuration."""
    return _section_of(name) in sections


def _section_of(name: str) -> str:
    return re.split(r"[.\[]", name)[0]


def _no_key(name: str, sections: Collection[str]) -> str:
    first = _section_of(name)
    return f"{name!r} is no key of the configuration: {first!r} is no section; {suggestion(first, sections)}"


def _check_keys(keys: Iterable[str], here: KeyPath, sections: Collection[str]) -> Iterator[ConfigProblem]:
    for key in keys:
        if key == "seed":
            text = "the worlds are the seeds; give `worlds` and `first_seed` instead"
            yield ConfigProblem((*here, key), text)
        elif not _is_key(key, sections):
            yield ConfigProblem((*here, key), _no_key(key, sections))
        else:
            try:
                key_path(key)
            except ValueError as error:
                yield ConfigProblem((*here, key), str(error))


def _check_overlap(section: ExperimentFile, factors: Iterable[Factor]) -> Iterator[ConfigProblem]:
    """Yield the problems of values that are given twice, and of keys that are changed twice."""
    owners = dict.fromkeys(section.set, "set")
    for factor in factors:
        labels = factor.labels
        for label in sorted({str(label) for label in labels if labels.count(label) > 1}):
            yield ConfigProblem(("factors", factor.name), f"{label} is given twice; give each value once")
        for key in sorted({key for choice in factor.choices for key in choice.changes}):
            if owners.setdefault(key, factor.name) != factor.name:
                text = f"{key} is also changed by {owners[key]}; change it in one place"
                yield ConfigProblem(("factors", factor.name), text)


def _factor(name: str, values: Steps | tuple[Any, ...], sections: Collection[str]) -> Factor:
    listed: tuple[Any, ...] = values if isinstance(values, tuple) else values.values
    if _is_key(name, sections):
        return Factor(name, tuple(Choice(label_of(value), {name: value}) for value in listed))
    choices = (Choice(label_of(v["name"]), {k: x for k, x in v.items() if k != "name"}) for v in listed)
    return Factor(name, tuple(choices))


def setups_of(
    section: ExperimentFile, data: Any, levels: Iterable[Level], factors: Sequence[Factor]
) -> tuple[list[Setup], list[ConfigProblem]]:
    """Return the setups of the levels, and one problem for each error of their configurations.

    `data` is the base. A problem names the first level that has the error.
    """
    kind = KINDS[section.kind]
    setups: list[Setup] = []
    refused: dict[tuple[KeyPath, str], list[Level]] = {}
    for level in levels:
        document, problems = data | {SETTINGS: section.search or {}}, []
        for key, value in {**section.set, **level.changes}.items():
            path = key_path(key)
            try:
                document = with_value(document, path, value)
            except ValueError as error:
                problems.append(ConfigProblem(path, str(error)))
        chosen = document.pop(SETTINGS)
        config, wrong = validate(document, check_config)
        settings, more = _settings(kind, chosen)
        problems += [*wrong, *more]
        if config is not None and not problems:
            scenario = build(config)
            if (why := kind.unsupported(scenario)) is not None:
                problems.append(ConfigProblem((), why))
            setups.append(Setup(config, settings, len(scenario.specs)))
        for problem in problems:
            refused.setdefault((problem.path, problem.text), []).append(level)
    found = [
        ConfigProblem(_cause(path, those[0], factors, section), _refusal(path, text, those))
        for (path, text), those in refused.items()
    ]
    return setups, found


def _settings(kind: Kind, data: Any) -> tuple[Section | None, list[ConfigProblem]]:
    if kind.settings is None:
        return None, []
    try:
        return kind.settings.model_validate(data), []
    except ValidationError as error:
        problems = schema_problems(error, data, kind.settings)
        return None, [ConfigProblem((SETTINGS, *problem.path), problem.text) for problem in problems]


def _refusal(path: KeyPath, text: str, levels: Sequence[Level]) -> str:
    n_more = len(levels) - 1
    more = f" (and {n_more} more level{'s' if n_more > 1 else ''})" if n_more else ""
    key = f"{dotted(path)}: " if path else ""
    level = f"the level {levels[0]}" if levels[0].values else str(levels[0])
    return f"{level} is refused{more}: {key}{text}"


def _cause(path: KeyPath, level: Level, factors: Sequence[Factor], section: ExperimentFile) -> KeyPath:
    """Return the place in the experiment file that changes a key; if there is none, that of the factors."""
    if not path:
        return ("factors",)
    for factor in factors:
        choice = factor.choices[factor.labels.index(level.values[factor.name])]
        if any(touches(key_path(key), path) for key in choice.changes):
            return "factors", factor.name
    return next((("set", key) for key in section.set if touches(key_path(key), path)), ("factors",))
