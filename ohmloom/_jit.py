"""Lazy compilation: numba comes with the first kernel module, and its cache lives in the user's cache.

The cache folder's name holds a digest of all kernel sources, because numba notices a change in a function but
not in the functions which that one calls.
"""

from __future__ import annotations

import atexit
import hashlib
import inspect
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])


def cache_directory() -> Path:
    """Folder of the compiled kernels of this version of the sources (it need not exist yet)."""
    if "OHMLOOM_CACHE" in os.environ:
        base = Path(os.environ["OHMLOOM_CACHE"])
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home())) / "ohmloom"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "ohmloom"
    digest = hashlib.sha256()
    root = Path(__file__).parent
    for source in sorted(root.rglob("*.py")):
        if "kernels" in source.name or "laws" in source.parts or source.name == "_jit.py":
            digest.update(source.read_bytes())
    return base / f"kernels-{digest.hexdigest()[:12]}"


def _writable_cache() -> str:
    """The cache folder, or one for this process where it cannot be written: never one without the sources' digest."""
    folder = cache_directory()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return str(folder)
    except OSError as error:
        substitute = tempfile.mkdtemp(prefix="ohmloom-kernels-")
        atexit.register(shutil.rmtree, substitute, ignore_errors=True)
        reason = error.strerror or error
        logging.getLogger(__name__).warning("%s: %s; kernels are compiled for this process only", folder, reason)
        return substitute


if "NUMBA_CACHE_DIR" not in os.environ:
    os.environ["NUMBA_CACHE_DIR"] = _writable_cache()
if "NUMBA_CACHE_LOCATOR_CLASSES" not in os.environ:
    # Ours first; the others are numba's, for other people's functions.
    os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = ",".join(
        ("ohmloom._kernel_cache.KernelCacheLocator", "UserProvidedCacheLocator", "InTreeCacheLocator",
         "UserWideCacheLocator", "IPythonCacheLocator", "ZipCacheLocator")
    )  # fmt: skip

# numba reads where its cache is when it is imported, so the imports come after these are set.
import numba  # noqa: E402
from numba.core import types  # noqa: E402
from numba.extending import intrinsic, overload, register_jitable  # noqa: E402

# Compiled functions keep the type of the plain ones for their callers, which numba's own types would hide.
_njit: Any = numba.njit
_intrinsic: Any = intrinsic
_overload: Any = overload
_register: Any = register_jitable
_config: Any = numba.config
COMPILED = not _config.DISABLE_JIT


def kernel(function: F) -> F:
    """Compile a free function of numbers and arrays; floating point stays strict, so results repeat."""
    compiled: F = _njit(cache=True, fastmath=False, nogil=True, error_model="numpy")(function)
    return compiled


def large_kernel(function: F) -> F:
    """Compile one that is never put into its callers by force, nor is what it calls.

    Callees inherit force when a form of `choose_by_type` is inlined, and each call of a large one would compile all of
    it again.
    """
    compiled: F = _njit(cache=True, fastmath=False, nogil=True, error_model="numpy", forceinline=False)(function)
    return compiled


def inner_kernel(function: F) -> F:
    """Compile a function that only other kernels call; it is compiled into them and not cached by itself."""
    compiled: F = _njit(cache=False, fastmath=False, nogil=True, error_model="numpy")(function)
    return compiled


def inlined_kernel(function: F) -> F:
    """Put a function into each of its callers: a call would copy the description of every array, and a function that is
    compiled by itself is optimised again with each caller."""
    compiled: F = _njit(cache=False, fastmath=False, nogil=True, error_model="numpy", inline="always")(function)
    return compiled


def _overload_as(like: Callable[..., Any], function: Callable[..., Any], **options: Any) -> Callable[[Any], Any]:
    """numba's `overload` of `function` for a choice that takes any arguments: it gets the signature of `like`."""

    def register(choose: Any) -> Any:
        # numba wants the very signature, annotations included; inspect reads it from this attribute.
        choose.__signature__ = inspect.signature(like)
        return _overload(function, **options)(choose)

    return register


def make_callable(function: Callable[..., Any], compiled_form: Callable[..., Any] | None = None) -> None:
    """Let kernels call a plain function, as it stands or in another form; called from Python it stays as it is."""
    if not COMPILED:
        return
    if compiled_form is None:
        _register(function)
        return

    def choose(*arguments: Any) -> Any:
        return compiled_form

    _overload_as(compiled_form, function)(choose)


def choose_by_type(function: Callable[..., Any], forms: dict[type, Callable[..., Any]]) -> None:
    """Let kernels call `function`, of which they compile the form that the NamedTuple class of its first argument
    names.

    So one kernel serves several kinds of data, and compiles, and caches, for each only what it needs. Called from
    Python, `function` must pick the form itself.
    """
    if not COMPILED:
        return

    def choose(*arguments: Any) -> Any:
        return forms[arguments[0].instance_class]

    _overload_as(function, function, jit_options={"forceinline": True})(choose)


def closure_kernel(tag: str, *, is_large: bool = False) -> Callable[[F], F]:
    """Compile a closure, like `inner_kernel`, under a name that no other closure of its factory has.

    The linker tells closures apart by qualified name and a count kept per process, so that one from the cache and
    a fresh one of the same factory could otherwise be taken for each other, and give wrong numbers.

    One that `is_large` is never put into its callers by force, see `large_kernel`.
    """
    options = {"forceinline": False} if is_large else {}

    def compile_named(function: F) -> F:
        function.__qualname__ = f"{function.__qualname__}.{tag}"
        compiled: F = _njit(cache=False, fastmath=False, nogil=True, error_model="numpy", **options)(function)
        return compiled

    return compile_named


@kernel
def copy_flat(target: Any, source: Any) -> None:
    """Copy one contiguous array into another of the same shape; `target[:] = source` takes seconds to compile."""
    flat, values = target.ravel(), source.ravel()
    for k in range(flat.shape[0]):
        flat[k] = values[k]


def _lowest_bit_plain(mask: int) -> int:
    return (int(mask) & -int(mask)).bit_length() - 1


def _lowest_bit_compiled(typingctx: Any, mask: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        from llvmlite import ir

        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), codegen


# Index of the lowest set bit of a non-zero int64 mask.
lowest_bit: Callable[[int], int] = _intrinsic(_lowest_bit_compiled) if COMPILED else _lowest_bit_plain
