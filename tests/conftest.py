"""Shared by all tests. The helpers in `tests/support` can be imported by their bare names."""
