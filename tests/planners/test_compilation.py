"""Machine code on disk follows the source of a kernel and of the kernels that it calls."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HELPER = "def twice(x):\n    return {factor} * x\n"
KERNEL = "from helper import twice\n\n\ndef kernel(x):\n    return twice(x) + 1\n"
CALL = """
from kernel import kernel
from swarmctl.planners.kernels.compilation import compiled

machine_code = compiled(kernel)
print(machine_code(10), sum(machine_code.stats.cache_hits.values()))
"""


def called_in_a_new_process(folder: Path) -> tuple[int, int]:
    """Return the kernel's result, and how often its machine code was on disk."""
    done = subprocess.run(
        [sys.executable, "-c", CALL], cwd=folder, capture_output=True, text=True, check=True
    )
    result, hits = done.stdout.split()
    return int(result), int(hits)


@pytest.mark.full
def test_a_changed_helper_in_another_file_is_compiled_again(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    (tmp_path / "helper.py").write_text(HELPER.format(factor=2))
    assert called_in_a_new_process(tmp_path) == (21, 0)
    assert called_in_a_new_process(tmp_path) == (21, 1)
    (tmp_path / "helper.py").write_text(HELPER.format(factor=3))
    assert called_in_a_new_process(tmp_path) == (31, 0)
