"""What time it is, for whom that matters, when a simulation begins: the same for logs and satellites.

A fixed date, so that equal runs write equal files.
"""

EPOCH_US = 1_767_225_600_000_000  # 2026-01-01T00:00:00Z, since 1970
