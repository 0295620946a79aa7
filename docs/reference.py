"""A hook of mkdocs that generates the references of configurations, experiments and commands."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from swarmctl.cli.main import load_command
from swarmctl.cli.registry import COMMANDS
from swarmctl.config.model import Config
from swarmctl.study.experiment_file import ExperimentFile
from swarmctl.study.kinds import KINDS

Schema = dict[str, Any]
LIMITS = {
    "minimum": "≥ {}", "exclusiveMinimum": "> {}", "maximum": "≤ {}", "exclusiveMaximum": "< {}",
    "minItems": "at least {} items", "maxItems": "at most {} items",
}  # fmt: skip


def on_files(files: Files, config: MkDocsConfig) -> Files:
    pages = {"reference/configuration.md": configuration(), "reference/commands.md": commands()}
    pages["reference/study.md"] = experiment()
    for path, text in pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def configuration() -> str:
    """Return the page of all keys of a configuration, one table for each section."""
    schema = Config.model_json_schema()
    lines = [
        "# Configuration reference",
        "",
        "Generated from the schema, which `swarmctl schema` prints for editors.",
        "",
        "## Top level",
        "",
        *_table(schema, schema["$defs"]),
    ]
    for key, part in schema["properties"].items():
        lines += _section(key, part, schema["$defs"], set())
    return "\n".join(lines) + "\n"


def experiment() -> str:
    """Return the page of all keys of an experiment file."""
    schema = ExperimentFile.model_json_schema()
    lines = ["# Experiment reference", "", "Generated from the schema of experiment files.", ""]
    lines += ["## Top level", "", *_table(schema, schema["$defs"])]
    for key, part in schema["properties"].items():
        lines += _section(key, part, schema["$defs"], set())
    for name, kind in KINDS.items():
        if kind.settings is not None:
            settings = kind.settings.model_json_schema()
            lines += ["", f"## `search` ({name})", "", *_table(settings, settings.get("$defs", {}))]
        lines += ["", f"## Measures ({name})", ""]
        lines += [", ".join(f"`{measure}`" for measure in kind.measures)]
    return "\n".join(lines) + "\n"


def _section(path: str, part: Schema, defs: Schema, above: set[str]) -> Iterator[str]:
    """Yield the lines of a section's table, then of the tables of its inner sections.

    `above` has the names of the enclosing sections.
    """
    for name in _references(part):
        inner = defs[name]
        if name in above or "properties" not in inner:
            continue
        kind = (
            f" ({inner['properties']['distribution']['const']})"
            if "distribution" in inner["properties"]
            else ""
        )
        yield from ("", f"## `{path}`{kind}", "")
        if text := _text(inner):
            yield from (text, "")
        yield from _table(inner, defs)
        for key, below in inner["properties"].items():
            yield from _section(f"{path}.{key}", below, defs, above | {name})


def _table(schema: Schema, defs: Schema) -> Iterator[str]:
    yield from ("| key | type | default | meaning |", "|---|---|---|---|")
    required = set(schema.get("required", ()))
    for key, part in schema["properties"].items():
        if "default" not in part:
            default = "required" if key in required else ""
        else:
            value = part["default"]
            default = "see below" if isinstance(value, dict) and value else f"`{json.dumps(value)}`"
        yield f"| `{key}` | {_cell(_type(part, defs))} | {_cell(default)} | {_cell(_text(part))} |"


def _references(part: Schema) -> Iterator[str]:
    """Yield the names of all definitions in a value's schema, including lists and alternatives."""
    if "$ref" in part:
        yield part["$ref"].rsplit("/", 1)[-1]
    for inner in [*part.get("anyOf", ()), *part.get("oneOf", ()), *part.get("prefixItems", ())]:
        yield from _references(inner)
    for key in ("items", "additionalProperties"):
        if isinstance(part.get(key), dict):
            yield from _references(part[key])


def _type(part: Schema, defs: Schema) -> str:
    if "$ref" in part:
        inner = defs[part["$ref"].rsplit("/", 1)[-1]]
        return "section" if "properties" in inner else _type(inner, defs)
    if "const" in part:
        return f"`{part['const']}`"
    if "enum" in part:
        return ", ".join(f"`{value}`" for value in part["enum"])
    if alternatives := part.get("anyOf") or part.get("oneOf"):
        return " or ".join(dict.fromkeys(_type(inner, defs) for inner in alternatives))
    kind = part.get("type", "any")
    if "prefixItems" in part:
        return "[" + ", ".join(_type(inner, defs) for inner in part["prefixItems"]) + "]"
    if kind == "array":
        kind = f"list of {_type(part.get('items') or {}, defs)}"
    limits = [text.format(part[name]) for name, text in LIMITS.items() if name in part]
    return " ".join([str(kind), ", ".join(limits)]).strip()


def commands() -> str:
    """Return the page of all commands with their options."""
    lines = [
        "# Command reference",
        "",
        "Generated from the commands; `swarmctl COMMAND --help` prints the same.",
    ]
    for name in COMMANDS:
        command = load_command(name)
        lines += _command(f"swarmctl {name}", command)
        for inner, below in getattr(command, "commands", {}).items():
            lines += _command(f"swarmctl {name} {inner}", below)
    return "\n".join(lines) + "\n"


def _command(name: str, command: Any) -> Iterator[str]:
    """Yield the lines of a command: its help, and a table of its options."""
    yield from ("", f"## `{name}`", "", command.help or "", "")
    yield from ("| option | default | meaning |", "|---|---|---|")
    for option in command.params:
        if option.name in ("help", "install_completion", "show_completion"):
            continue
        is_argument = option.param_type_name == "argument"
        words = [] if is_argument else [", ".join(option.opts)]
        names = " ".join([*words, option.metavar or (option.name.upper() if is_argument else "")]).strip()
        shown = option.default not in (None, False, [], ()) and not callable(option.default)
        default = "required" if option.required else f"`{option.default}`" if shown else ""
        yield f"| `{names}` | {_cell(default)} | {_cell(getattr(option, 'help', None) or '')} |"


def _text(part: Schema) -> str:
    return re.sub(r"\s+", " ", part.get("description", "")).strip()


def _cell(text: str) -> str:
    return re.sub(r"\s+", " ", text).replace("|", "\\|").replace("<", "&lt;")
