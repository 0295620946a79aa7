"""Problems of a configuration, each with its place in the file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import msgspec

from swarmctl.config.yaml_lines import Document, KeyPath


class ConfigProblem(msgspec.Struct, frozen=True):
    """One error of a configuration: the place in the file, and the error with advice."""

    path: KeyPath
    text: str
    depends_on: KeyPath = ()
    """path of another value that causes the problem; if that value is wrong, this problem is not reported"""


class ConfigError(Exception):
    """All errors of a configuration; `lines` has a line for each, such as `file:line: key: error; advice`."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = lines


def problem_lines(path: Path, document: Document, problems: Iterable[ConfigProblem]) -> list[str]:
    """Return a line for each problem, with file, line and key, in the order of the file."""
    found = sorted((document.line_of(p.path), dotted(p.path), p.text) for p in problems)
    return [f"{path}:{line}: {key}: {text}" for line, key, text in found]


def dotted(path: KeyPath) -> str:
    """Return a path as text, such as `vehicles[0].goal`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text or "(file)"
