"""Machine code on disk follows a kernel, the kernels that it calls, and the constants that they use."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

HELPER = "def twice(x):\n    return {factor} * x\n"
LAYOUT = "SHIFT = {shift}\n"
KERNEL = (
    "from helper import twice\nfrom layout import SHIFT\n\n\ndef kernel(x):\n    return twice(x) + SHIFT\n"
)
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
@pytest.mark.parametrize(
    ("file", "text", "result"),
    [("helper.py", HELPER.format(factor=3), 31), ("layout.py", LAYOUT.format(shift=2), 22)],
)
def test_a_change_in_another_file_is_compiled_again(
    file: str, text: str, result: int, tmp_path: Path
) -> None:
    (tmp_path / "kernel.py").write_text(KERNEL)
    (tmp_path / "helper.py").write_text(HELPER.format(factor=2))
    (tmp_path / "layout.py").write_text(LAYOUT.format(shift=1))
    assert called_in_a_new_process(tmp_path) == (21, 0)
    assert called_in_a_new_process(tmp_path) == (21, 1)
    (tmp_path / file).write_text(text)
    assert called_in_a_new_process(tmp_path) == (result, 0)
