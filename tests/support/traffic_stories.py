"""Intents of other vehicles around the middle of the area."""

from __future__ import annotations

from agent_stories import GRID

from swarmctl.core import events as ev

AMSL_M = 330.0
"""at 30 m above home"""


MID_M = GRID.centre_m((4, 4))


def operator_texts(effects: list[ev.Effect]) -> list[str]:
    return [effect.text for effect in effects if isinstance(effect, ev.NotifyOperator)]
