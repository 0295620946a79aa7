"""Changed copies of records: a record is a frozen `msgspec.Struct`, which is quick to make and to copy."""

from __future__ import annotations

from typing import TYPE_CHECKING

__all__ = ["replace"]

if TYPE_CHECKING:
    from dataclasses import replace  # so that mypy checks names and types of the changes
else:
    from msgspec.structs import replace
