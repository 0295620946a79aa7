"""Simulated time: its start date and the tolerance for equal times.

Logs and SYSTEM_TIME contain the date. The start date is fixed, so that equal runs write equal files.
"""

EPOCH_US = 1_767_225_600_000_000  # 2026-01-01T00:00:00Z as UNIX time
EPSILON_S = 1e-9  # tolerance for equal times
