"""A flight by the command line, as a process, for all tests that read its files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from swarmctl_process import run

SMALL = """\
name: small
area: {origin_lat_deg: 46.0, origin_lon_deg: 14.4, rows: 8, cols: 8, cell_size_m: 50}
threats: {count: 5}
simulate: {count: 2, ready_s: 3.0}
"""
PROGRAM = (
    "import sys\nfrom swarmctl.cli.main import cli\n"
    "try: cli(sys.argv[1:])\nexcept SystemExit as ended: assert not ended.code, ended.code\n"
    "print(*(name for name in ('numba', 'llvmlite') if name in sys.modules))"
)


@dataclass(frozen=True, slots=True)
class CliFlight:
    run: Path
    """run folder"""
    output: str
    compilers: list[str]
    """modules of the compiler that the process has loaded"""


def fly(folder: Path, *words: str | Path) -> CliFlight:
    """Fly on the virtual clock; `words` select the configuration."""
    out = folder / "runs"
    done = run("fly", "--clock", "virtual", "--out", out, *words, cwd=None, timeout_s=300.0, program=PROGRAM)
    assert done.returncode == 0, done.stdout + done.stderr
    (run_folder,) = out.iterdir()
    *lines, compilers = done.stdout.splitlines()
    return CliFlight(run_folder, "\n".join(lines), compilers.split())
