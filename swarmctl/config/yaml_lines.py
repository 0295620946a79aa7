"""A YAML parser that keeps the line of each key."""

from __future__ import annotations

from typing import Any

import msgspec
import yaml

KeyPath = tuple[str | int, ...]

MAX_VALUES = 300_000
"""greatest number of keys and list items, with aliases expanded"""


def touches(path: KeyPath, other: KeyPath) -> bool:
    """Return whether one of two keys is the other, or within it."""
    shorter = min(len(path), len(other))
    return path[:shorter] == other[:shorter]


class YamlError(ValueError):
    """Malformed YAML, or a repeated key; `line` is the line number, from 1."""

    def __init__(self, line: int, text: str) -> None:
        super().__init__(text)
        self.line = line
        self.text = text


class Document(msgspec.Struct, frozen=True):
    """The data of a file, with tuples for lists, and the line of each path."""

    data: Any
    lines: dict[KeyPath, int]

    def line_of(self, path: KeyPath) -> int:
        """Return the line of the deepest part of `path` that the file has; 1 if there is none."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.lines:
                return self.lines[path[:length]]
        return 1


class _Loader(yaml.SafeLoader):
    """A loader that raises YamlError for a scalar that does not fit its tag, such as a date of month 13."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            return super().construct_object(node, deep)
        try:
            return super().construct_object(node, deep)
        except (ValueError, AttributeError, LookupError, OverflowError) as error:
            text = f"{node.value!r:.60} is no valid {node.tag.rpartition(':')[2]}; write a text in quotes"
            raise YamlError(node.start_mark.line + 1, text) from error


def parse(text: str) -> Document:
    """Return the document of a YAML text. Raises YamlError."""
    loader = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None:
            raise YamlError(1, "the file is empty; `swarmctl init FILE` writes a starter configuration")
        lines: dict[KeyPath, int] = {}
        _walk(node, (), lines)
        return Document(_tupled(loader.construct_document(node)), lines)
    except yaml.MarkedYAMLError as error:
        # A key without a colon begins at its context; the parser notices it on a later line.
        begins_at_context = error.context == "while scanning a simple key"
        mark = error.context_mark if begins_at_context else error.problem_mark or error.context_mark
        line = mark.line + 1 if mark is not None else 1
        raise YamlError(line, f"the YAML is malformed: {error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise YamlError(1, f"the YAML is malformed: {str(error).splitlines()[0]}") from error
    except RecursionError as error:
        raise YamlError(1, "the nesting is too deep, or an alias contains itself; remove levels") from error
    finally:
        if loader is not None:
            loader.dispose()


def _walk(node: yaml.Node, path: KeyPath, lines: dict[KeyPath, int]) -> None:
    """Note the line of each key and list item below a node. Raises YamlError for a repeated key."""
    if len(lines) > MAX_VALUES:
        text = f"the file has more than {MAX_VALUES} values, with its aliases expanded; remove aliases"
        raise YamlError(node.start_mark.line + 1, text)
    if isinstance(node, yaml.MappingNode):
        for key_node, value_node in node.value:
            here = (*path, str(key_node.value))
            line = key_node.start_mark.line + 1
            if here in lines:
                raise YamlError(line, f"key {here[-1]!r} is already on line {lines[here]}; remove one")
            lines[here] = line
            _walk(value_node, here, lines)
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            lines[(*path, index)] = item.start_mark.line + 1
            _walk(item, (*path, index), lines)


def _tupled(data: Any) -> Any:
    """Return `data` with tuples for lists, because the validation of sections is strict."""
    if isinstance(data, dict):
        return {key: _tupled(value) for key, value in data.items()}
    return tuple(map(_tupled, data)) if isinstance(data, list) else data
