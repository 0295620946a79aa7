"""The address that a command with a dashboard prints, and the facts on its cards."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable, Mapping
from typing import Any

from swarmctl_process import read_until

StartDashboard = Callable[..., subprocess.Popen[str]]
"""from the words of a command, and `cwd`, to its process"""


def address_of(process: subprocess.Popen[str]) -> str:
    """Wait until a process prints the address of its dashboard, and return it."""
    (address,) = addresses_of(process, 1)
    return address


def addresses_of(process: subprocess.Popen[str], n: int) -> list[str]:
    """Wait until a process prints several addresses of its dashboard, and return them."""
    return [re.findall(r"https?://\S+", read_until(process, "token=")[-1])[0] for _ in range(n)]


def await_facts(card: Any, cells: int, facts: Mapping[str, Any]) -> None:
    """Wait until a vehicle's card shows its known cells, and the facts of its summary or result."""
    card.filter(has_text=f"known cells: {cells}, known hostiles: {facts['hostiles_known']}").wait_for()
    card.filter(has_text=f"changes of route: {facts['replans']}, strikes: {facts['strikes']}").wait_for()
