"""Numbers in tables."""

from __future__ import annotations

SMALL = 1e-3
"""what is less is told by its first digits, wherever they begin"""


def product_text(safety_factor: float) -> str:
    """∏(1 − P_s) with four decimals, or three significant digits where it is SMALL; 0 only where it is."""
    if safety_factor == 0.0:
        return "0"
    return f"{safety_factor:.4f}" if safety_factor >= SMALL else f"{safety_factor:.3g}"
