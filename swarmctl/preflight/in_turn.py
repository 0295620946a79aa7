"""In which order parameters are written. Pure."""

from __future__ import annotations

from collections.abc import Mapping

TAKES_UP_S = 0.5
"""An ArduPilot looks at its fence's parameters ten times a second."""


def in_turn(wrong: Mapping[str, float], told: Mapping[str, float]) -> tuple[dict[str, float], ...]:
    """What to write one after the other, `TAKES_UP_S` apart, of parameters that are `wrong`.

    ArduPilot takes up which limits count when FENCE_ENABLE changes, and not when FENCE_TYPE does
    (`AC_Fence::update`, since 4.6): a plane's fence as it comes would have no ceiling until the next boot.
    """
    if "FENCE_TYPE" not in wrong or "FENCE_ENABLE" not in told:
        return (dict(wrong),)
    # First, and by itself: were the others written and this not, all would look right the next time.
    disabled = ({"FENCE_ENABLE": 0.0},) if told["FENCE_ENABLE"] else ()
    others = {name: value for name, value in wrong.items() if name != "FENCE_ENABLE"}
    return *disabled, others, {"FENCE_ENABLE": 1.0}
