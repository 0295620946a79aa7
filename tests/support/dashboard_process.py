"""The address that a command with a dashboard prints."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable

from swarmctl_process import read_until

StartDashboard = Callable[..., str]
"""from the words of a command, and `cwd`, to the address of its dashboard"""


def address_of(process: subprocess.Popen[str]) -> str:
    """Wait until a process prints the address of its dashboard, and return it."""
    (address,) = re.findall(r"https?://\S+", read_until(process, "token=")[-1])
    return address
