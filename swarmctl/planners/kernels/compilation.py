"""Compilation of kernels by numba, at their first use.

A kernel is a plain function of arrays and numbers. Its machine code releases the interpreter lock. Only this
module imports numba, and only at the first call.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar

from swarmctl.planners.kernels.lattice import Floats, offsets_of

P = ParamSpec("P")
R = TypeVar("R")


def prefetch(array: Floats, index: int) -> None:
    """Fetch an element into the processor's cache; the index may be outside of the array."""


@functools.cache
def _prefetch() -> Any:
    """Return `prefetch` as an instruction for numba's compiler."""
    from llvmlite import ir  # noqa: PLC0415
    from numba import types  # noqa: PLC0415
    from numba.extending import intrinsic  # noqa: PLC0415

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        instruction = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        address = builder.bitcast(builder.gep(array.data, [arguments[1]]), byte)
        builder.call(instruction, [address, number(0), number(3), number(1)])  # read, keep, data
        return context.get_dummy_value()

    def fetch(_context: Any, array: Any, index: Any) -> Any:
        return types.void(array, index), generate

    return intrinsic(fetch)


@functools.cache
def _dispatcher(kernel: FunctionType) -> Any:
    """Return numba's dispatcher of a kernel and of the kernels that it calls; its first call compiles."""
    from numba import njit  # noqa: PLC0415 - small areas need no numba

    called = _called_by(kernel)
    helpers = {
        name: _prefetch() if value is prefetch else _dispatcher(value) for name, value in called.items()
    }
    linked = FunctionType(kernel.__code__, kernel.__globals__ | helpers, kernel.__name__, kernel.__defaults__)
    try:
        dispatcher: Any = njit(nogil=True, cache=True)(linked)
    except RuntimeError:  # no folder for the cache is writable
        return njit(nogil=True)(linked)
    # numba compiles again after a change of the kernel's own file; this adds its helpers and constants.
    with contextlib.suppress(AttributeError):  # numba has no public name for the stamp
        stored = dispatcher._cache._cache_file
        stored._source_stamp = (stored._source_stamp, _digest(kernel))
    return dispatcher


def _called_by(kernel: FunctionType) -> dict[str, FunctionType]:
    """Return the kernels that a kernel calls, by name."""
    called = {name: kernel.__globals__.get(name) for name in kernel.__code__.co_names}
    return {name: value for name, value in called.items() if isinstance(value, FunctionType)}


@functools.cache
def _digest(kernel: FunctionType) -> str:
    """Return a digest of a kernel's file, of the constants that it uses, and of the kernels that it calls."""
    code, values = kernel.__code__, kernel.__globals__
    constants = {
        name: values[name]
        for name in code.co_names
        if name in values and not isinstance(values[name], FunctionType | ModuleType)
    }
    parts = [Path(code.co_filename).read_text(encoding="utf-8"), repr(constants)]
    parts += map(_digest, _called_by(kernel).values())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def compiled(kernel: Callable[P, R]) -> Callable[P, R]:
    """Return the kernel as machine code; numba caches the code on disk if a folder is writable."""
    return _dispatcher(kernel)  # type: ignore[no-any-return]


def numba_cache() -> tuple[Path, str] | None:
    """Return numba's cache folder, and a key of this machine, Python, numba and the files of the kernels.

    None if no folder is writable; numba then compiles again in each process.
    """
    import numba  # noqa: PLC0415
    from numba.core.registry import cpu_target  # noqa: PLC0415

    folder = _dispatcher(offsets_of).stats.cache_path
    if folder is None:
        return None
    stamps = sorted((file.name, file.stat().st_mtime_ns) for file in Path(__file__).parent.glob("*.py"))
    machine = cpu_target.target_context.codegen().magic_tuple()
    text = repr((numba.__version__, sys.version_info[:3], machine, stamps))
    return Path(folder), hashlib.sha256(text.encode()).hexdigest()[:16]
