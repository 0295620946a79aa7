"""An experiment, ready to run: its levels and their configurations.

`load_experiment` reads an experiment file and the configuration that it names. Every level becomes a
configuration that passes the checks of a flight. `ConfigError` lists each error with file, line and advice.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
from pydantic import ValidationError

from swarmctl.config import yaml_lines
from swarmctl.config.checks import check_config
from swarmctl.config.model import load, read_document, schema_problems
from swarmctl.config.problems import ConfigError, ConfigProblem, problem_lines
from swarmctl.config.yaml_lines import Document
from swarmctl.study.experiment_checks import Setup, check_file, factors_of, setups_of
from swarmctl.study.experiment_file import ExperimentFile
from swarmctl.study.kinds import KINDS, Kind
from swarmctl.study.levels import Factor, Level, Scalar, levels_of


class Experiment(msgspec.Struct, frozen=True):
    """An experiment without problems."""

    text: str
    base_text: str
    section: ExperimentFile
    factors: tuple[Factor, ...]
    levels: tuple[Level, ...]
    setups: tuple[Setup, ...]
    """one for each level"""
    worlds: int

    @property
    def kind(self) -> Kind:
        return KINDS[self.section.kind]

    @property
    def seeds(self) -> range:
        """All seeds of a level; with `until` the experiment may need fewer."""
        return range(self.section.first_seed, self.section.first_seed + self.worlds)

    @property
    def most_rows(self) -> int:
        """The greatest possible number of rows of the results."""
        return self.worlds * sum(setup.n_vehicles for setup in self.setups)

    def is_precise(self, half_width: float | None) -> bool:
        """Return whether the widest interval, half of it, fulfils `until`."""
        until = self.section.until
        return until is not None and half_width is not None and half_width <= until.half_width

    @property
    def values(self) -> Mapping[str, list[Scalar]]:
        """The values of each factor that levels have, in the order of the experiment file."""
        used = {f.name: {level.values[f.name] for level in self.levels} for f in self.factors}
        return {f.name: [label for label in f.labels if label in used[f.name]] for f in self.factors}

    @property
    def identity(self) -> Mapping[str, Any]:
        """All that decides the rows of a seed, as JSON data."""
        section = self.section
        chosen = {
            "kind": section.kind,
            "base": yaml_lines.parse(self.base_text).data,
            "set": section.set,
            "search": section.search,
            "levels": [dict(level.values) for level in self.levels],
            "changes": [dict(level.changes) for level in self.levels],
            "tracks": section.tracks,
        }
        return dict(json.loads(json.dumps(chosen)))

    @property
    def portable_text(self) -> str:
        """The text of the experiment file for the results folder: its base is `base.yaml` beside it."""
        text = re.sub(r"(?m)^base:.*$", "base: base.yaml", self.text, count=1)
        if self.worlds == self.section.worlds:
            return text
        line = f"worlds: {self.worlds}"
        if "worlds" not in self.section.model_fields_set:
            return f"{text.rstrip()}\n{line}\n"
        return re.sub(r"(?m)^worlds:.*$", line, text, count=1)


def load_experiment(path: Path, worlds: int | None = None) -> Experiment:
    """Return the experiment of a file, with another number of worlds if given. Raises ConfigError."""
    document = read_document(path)
    try:
        section = ExperimentFile.model_validate(document.data)
    except ValidationError as error:
        raise _error(path, document, schema_problems(error, document.data, ExperimentFile)) from None
    worlds = section.worlds if worlds is None else worlds
    factors, problems = factors_of(section)
    problems += check_file(section, worlds)
    base_path = path.parent / section.base
    if not base_path.is_file():
        text = f"{base_path} does not exist; give a configuration, relative to this file"
        problems.append(ConfigProblem(("base",), text))
    if problems:
        raise _error(path, document, problems)
    load(base_path, check_config)
    try:
        levels = levels_of(factors, section.where)
    except ValueError as error:
        raise _error(path, document, [ConfigProblem(("where",), str(error))]) from None
    setups, problems = setups_of(section, read_document(base_path).data, levels, factors)
    if not levels:
        problems.append(ConfigProblem(("where",), "no combination of values is left; correct the conditions"))
    text, base_text = (file.read_text(encoding="utf-8") for file in (path, base_path))
    experiment = Experiment(text, base_text, section, tuple(factors), tuple(levels), tuple(setups), worlds)
    problems += _figure_problems(experiment)
    if problems:
        raise _error(path, document, problems)
    return experiment


def _figure_problems(experiment: Experiment) -> Iterator[ConfigProblem]:
    if not experiment.section.figures:
        return
    from swarmctl.study.figures import validate  # noqa: PLC0415 - loads matplotlib

    for i, figure in enumerate(experiment.section.figures):
        try:
            validate(figure, experiment.values, experiment.kind.measures)
        except ValueError as error:
            yield ConfigProblem(("figures", i), str(error))


def _error(path: Path, document: Document, problems: Iterable[ConfigProblem]) -> ConfigError:
    return ConfigError(problem_lines(path, document, problems))
