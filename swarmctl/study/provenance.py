"""The programs that compute a study: versions of packages, and the commit of a checkout."""

from __future__ import annotations

import platform
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import swarmctl

PACKAGES = ("numpy", "scipy", "numba", "pydantic", "dask", "distributed", "pandas", "pyarrow", "matplotlib")
DECISIVE = ("swarmctl", "python", "numpy", "scipy", "numba")
"""programs that could change a result; all workers have the same versions of these"""


@cache
def versions() -> dict[str, str]:
    """Return the versions of this process, by name."""
    found = {"swarmctl": swarmctl.__version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def commit() -> str | None:
    """Return the commit of the checkout that runs, with `+` after it if files differ; None: no checkout."""
    git = ["git", "-C", str(Path(swarmctl.__file__).parent)]
    try:
        found = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True)
        changed = subprocess.run(
            [*git, "diff", "--quiet", "HEAD", "--", "."], check=False, capture_output=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return found.stdout.strip() + ("+" if changed.returncode else "")
