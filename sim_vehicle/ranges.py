"""Ranges of numbers as text: `1-3, 7`."""

from collections.abc import Iterable


def ranges(numbers: Iterable[int]) -> str:
    """Return the numbers, sorted and each once, as text: 7, 3, 1, 2 become `1-3, 7`."""
    runs: list[list[int]] = []
    for number in sorted(set(numbers)):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs)
