"""YAML and JSON with the line number of each key."""

import json
from dataclasses import dataclass
from typing import Any

import yaml

KeyPath = tuple[str | int, ...]

MAX_VALUES = 300_000
"""greatest number of keys and list items, with aliases expanded"""


class FileSyntaxError(ValueError):
    """A syntax error or a duplicate key; `line` counts from 1."""

    def __init__(self, line: int, text: str) -> None:
        super().__init__(text)
        self.line, self.text = line, text


@dataclass(frozen=True, slots=True)
class Document:
    """The content of a file, and the line of each key path."""

    data: Any
    lines: dict[KeyPath, int]

    def line_of(self, path: KeyPath) -> int:
        """Return the line of the longest prefix of `path` in the file; 1 without such a prefix."""
        for length in range(len(path), 0, -1):
            if path[:length] in self.lines:
                return self.lines[path[:length]]
        return 1


def parse(text: str, *, as_json: bool = False) -> Document:
    """Return the content of a YAML or JSON document; raise FileSyntaxError with the line of an error.

    The YAML parser finds the lines of a JSON document, because JSON without tabs is YAML. It does not find
    the values: `1e-07` is a text in YAML, and `\\ud83d\\ude00` is not one character.
    """
    if not as_json:
        return _parse_yaml(text)
    try:
        data = json.loads(text)
    except json.JSONDecodeError as error:
        raise FileSyntaxError(error.lineno, f"invalid JSON: {error.msg} (column {error.colno})") from error
    except (ValueError, RecursionError) as error:  # a number of thousands of digits, a deep nesting
        raise FileSyntaxError(1, f"invalid JSON: {error}") from error
    return Document(data, _parse_yaml(text.replace("\t", " ")).lines)


class _Loader(yaml.SafeLoader):
    """A loader that raises FileSyntaxError for a value that does not fit its type."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if not isinstance(node, yaml.ScalarNode):
            return super().construct_object(node, deep)
        try:
            return super().construct_object(node, deep)
        except (ValueError, AttributeError, LookupError, OverflowError) as error:
            kind = node.tag.rpartition(":")[2]
            text = f"{node.value!r:.60} is not a valid {kind}; write a text in quotes"
            raise FileSyntaxError(node.start_mark.line + 1, text) from error


def _parse_yaml(text: str) -> Document:
    loader = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None:
            raise FileSyntaxError(1, "the file is empty; add at least `vehicles` or `count`")
        lines: dict[KeyPath, int] = {}
        _walk(node, (), lines)
        return Document(loader.construct_document(node), lines)
    except yaml.MarkedYAMLError as error:
        # A key without a colon begins at its context; the parser notices it on a later line.
        begins_at_context = error.context == "while scanning a simple key"
        mark = error.context_mark if begins_at_context else error.problem_mark or error.context_mark
        line = mark.line + 1 if mark is not None else 1
        raise FileSyntaxError(line, f"invalid YAML: {error.problem or error.context}") from error
    except yaml.YAMLError as error:
        raise FileSyntaxError(1, f"invalid YAML: {str(error).splitlines()[0]}") from error
    except RecursionError as error:
        raise FileSyntaxError(
            1, "the nesting is too deep, or an alias contains itself; remove levels"
        ) from error
    finally:
        if loader is not None:
            loader.dispose()


def _walk(node: yaml.Node, path: KeyPath, lines: dict[KeyPath, int]) -> None:
    if len(lines) > MAX_VALUES:
        text = f"the file has more than {MAX_VALUES} values, with its aliases expanded; remove aliases"
        raise FileSyntaxError(node.start_mark.line + 1, text)
    if isinstance(node, yaml.MappingNode):
        for key_node, value_node in node.value:
            key_path = (*path, str(key_node.value))
            line = key_node.start_mark.line + 1
            if key_path in lines:
                raise FileSyntaxError(
                    line,
                    f"key {key_path[-1]!r} is a duplicate of line {lines[key_path]}; remove one of the two",
                )
            lines[key_path] = line
            _walk(value_node, key_path, lines)
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            lines[(*path, index)] = item.start_mark.line + 1
            _walk(item, (*path, index), lines)
