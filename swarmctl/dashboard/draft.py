"""A configuration that is being edited: its text with all comments, its problems, and a safe save.

An edit changes single values. Comments and all other values stay as they are: each edit is read back and
compared. A save refuses a configuration with problems, and a file that has changed since it was read.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import YAMLError

from swarmctl.config import yaml_lines
from swarmctl.config.checks import check_config
from swarmctl.config.examples import starter
from swarmctl.config.model import Config, validate
from swarmctl.config.problems import ConfigError, problem_lines
from swarmctl.config.yaml_lines import Document, KeyPath
from swarmctl.core.whole_file import write_whole

STARTER_VEHICLES = 5
"""vehicles of the configuration with which a new file begins"""


class Draft:
    """The text of a configuration in the making."""

    def __init__(self, path: Path, text: str, read: bytes | None = None) -> None:
        """`read`: bytes of the file when it was read; None: there was no file."""
        self.path, self.text = path, text
        self._read = read
        self._earlier: list[str] = []

    @classmethod
    def open(cls, path: Path) -> Draft:
        """Return the draft of a file, or of a starter configuration for a new file. Raises ConfigError."""
        try:
            read = path.read_bytes()
            draft = cls(path, read.decode(), read)
        except FileNotFoundError:
            return cls(path, starter(str(path), STARTER_VEHICLES, real=False))
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError([f"{path}: the file cannot be read: {error}"]) from error
        try:
            draft.value(())
        except yaml_lines.YamlError as error:
            raise ConfigError([f"{path}:{error.line}: {error.text}"]) from error
        return draft

    @property
    def document(self) -> Document:
        return yaml_lines.parse(self.text)

    def value(self, path: KeyPath, default: Any = None) -> Any:
        """Return a value of the text, or `default` if the text does not have it."""
        data = self.document.data
        for part in path:
            try:
                data = data[part]
            except (KeyError, IndexError, TypeError):
                return default
        return data

    def edited(self, changes: Mapping[KeyPath, Any]) -> str:
        """Return the text with other values; None removes a key.

        Raises ValueError if the change does not leave all other values as they were.
        """
        wanted = _plain(self.document.data)
        for path, value in changes.items():
            _set(wanted, path, value)
        yaml = _round_trip()
        try:
            root = yaml.load(self.text)
            for path, value in changes.items():
                _set(root, path, value)
            written = io.StringIO()
            yaml.dump(root, written)
            found = _plain(yaml_lines.parse(written.getvalue()).data)
        except YAMLError as error:
            raise ValueError(f"the text cannot be edited: {error}; edit the file itself") from error
        if found != wanted:
            names = ", ".join(".".join(map(str, path)) for path in changes)
            raise ValueError(f"{names}: the change would alter other values as well; edit the file itself")
        return written.getvalue()

    def edit(self, changes: Mapping[KeyPath, Any]) -> None:
        """Change values. Raises ValueError, and then changes nothing."""
        text = self.edited(changes)
        if text != self.text:
            self._earlier.append(self.text)
            self.text = text

    def undo(self) -> bool:
        """Take the last change back; False if there is none."""
        if not self._earlier:
            return False
        self.text = self._earlier.pop()
        return True

    def copy(self) -> Draft:
        """Return a draft of the present text, which later edits of this one do not change."""
        return Draft(self.path, self.text, self._read)

    def schema_config(self) -> Config | None:
        """Return the configuration if each value by itself is valid; None otherwise."""
        return validate(self.document.data)[0]

    def checked(self) -> tuple[Config | None, list[str]]:
        """Return the configuration, None if it is invalid, and a line for each problem with its place."""
        document = self.document
        config, problems = validate(document.data, check_config)
        lines = problem_lines(self.path, document, problems)
        return (None if problems else config), lines

    def save(self) -> None:
        """Write the file whole, or not at all. Raises ConfigError with the reasons for a refusal."""
        _, lines = self.checked()
        if lines:
            raise ConfigError(lines)
        target = self.path.resolve()
        now = target.read_bytes() if target.exists() else None
        if now != self._read:
            text = "the file has changed since it was opened, and was not written; open it again"
            raise ConfigError([f"{self.path}: {text}"])
        content = self.text.encode()
        try:
            write_whole(target, content)
        except OSError as error:
            text = f"the file cannot be written: {error.strerror or error}"
            raise ConfigError([f"{self.path}: {text}"]) from error
        self._read = content


def _round_trip() -> YAML:
    yaml = YAML(typ="rt")
    yaml.preserve_quotes = True
    yaml.width = 1 << 16
    yaml.indent(mapping=2, sequence=4, offset=2)
    return yaml


def _plain(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    return [_plain(value) for value in data] if isinstance(data, tuple) else data


def _set(root: Any, path: KeyPath, value: Any) -> None:
    *parents, last = path
    for part in parents:
        if isinstance(root, dict) and root.get(part) is None:
            root[part] = CommentedMap()
        root = root[part]
    if value is None and isinstance(root, dict):
        root.pop(last, None)
    elif isinstance(value, list) and isinstance(root, CommentedMap):
        root[last] = _in_a_line(value)
    else:
        root[last] = value


def _in_a_line(value: list[Any]) -> CommentedSeq:
    sequence = CommentedSeq(_in_a_line(item) if isinstance(item, list) else item for item in value)
    sequence.fa.set_flow_style()
    return sequence
