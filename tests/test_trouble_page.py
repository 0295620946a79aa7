"""The codes at the end of messages, and their rows in docs/trouble.md."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from swarmctl.agent.failsafes import ALWAYS_ON, RULES

ROOT = Path(__file__).parents[1]
UNITS = {
    "bytes",
    "cells",
    "characters",
    "columns",
    "days",
    "deg",
    "heartbeats",
    "in",
    "j",
    "leader",
    "index",
    "m",
    "n",
    "pt",
    "px",
    "rad",
    "s",
    "steps",
    "vehicles",
}
"""words in brackets that are units or indices"""
EXTRAS = {"dashboard", "study"}
"""optional parts of the package, as in `pip install '.[study]'`"""
CODE = re.compile(r"\[([a-z]+(?:-[a-z]+)*)\]")
RULE_CODES = {rule.NAME.replace("_", "-") for rule in (*RULES, *(active.rule for active in ALWAYS_ON))}


def in_messages() -> set[str]:
    """Return everything in brackets that string literals of the product have: codes, units and indices."""
    found: set[str] = set()
    for path in (ROOT / "swarmctl").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.update(CODE.findall(node.value))
    return found


def test_each_code_of_a_message_stands_once_on_the_page() -> None:
    page = re.findall(r"`\[([a-z-]+)\]`", (ROOT / "docs" / "trouble.md").read_text(encoding="utf-8"))
    codes = in_messages()
    assert codes - UNITS - EXTRAS | RULE_CODES <= set(page)
    assert set(page) <= codes | RULE_CODES
    assert sorted(page) == sorted(set(page))
