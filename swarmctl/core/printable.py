"""Text of others on a terminal of ours."""

from __future__ import annotations


def printable(text: str) -> str:
    """What cannot be printed, such as a terminal's escapes, becomes `?`."""
    return "".join(c if c.isprintable() else "?" for c in text)
