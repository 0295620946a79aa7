"""Compilation of kernels by numba, when one is first needed.

A kernel is a plain function of arrays and numbers. `compiled` returns it as machine code that releases the
interpreter lock. This module alone uses numba, and imports it at the first call.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


@functools.cache
def _dispatcher(kernel: FunctionType) -> Any:
    """Return the kernel for numba, linked with the kernels that it calls; the first call compiles it."""
    from numba import njit  # noqa: PLC0415 - small areas do without

    called = {name: kernel.__globals__.get(name) for name in kernel.__code__.co_names}
    helpers = {name: _dispatcher(value) for name, value in called.items() if isinstance(value, FunctionType)}
    linked = FunctionType(kernel.__code__, kernel.__globals__ | helpers, kernel.__name__, kernel.__defaults__)
    try:
        return njit(nogil=True, cache=True)(linked)
    except RuntimeError:  # no folder for the cache can be written
        return njit(nogil=True)(linked)


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Return the kernel as machine code; numba stores it on disk for later processes."""
    return _dispatcher(kernel)  # type: ignore[no-any-return]


def cache_folder(kernel: Callable[..., object]) -> str | None:
    """Return the folder in which numba stores the kernel; None if no folder is writable."""
    return _dispatcher(kernel).stats.cache_path  # type: ignore[no-any-return]
