"""Simulated time: what date it begins at, and which two times are the same.

The date matters to logs and satellites, and is fixed, so that equal runs write equal files.
"""

EPOCH_US = 1_767_225_600_000_000  # 2026-01-01T00:00:00Z, since 1970
EPSILON_S = 1e-9  # sums of ticks need not be equal to the last bit
