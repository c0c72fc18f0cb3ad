"""Where numba finds compiled kernels again: by room and file of the package, wherever that is installed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numba.core.caching import UserProvidedCacheLocator

PACKAGE = Path(__file__).resolve().parent


class KernelCacheLocator(UserProvidedCacheLocator):
    """Cache of a function of this package, in a folder named after its room.

    numba's own locators name it after the absolute path, so that every new environment would compile everything again.
    What the functions call is no matter of theirs either: the cache's folder is named after all kernel sources.
    """

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """The locator, or None for a function of another package, which numba's own locators then find."""
        numbas: Any = super()  # which has no types
        return numbas.from_function(py_func, py_file) if PACKAGE in Path(py_file).resolve().parents else None

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Path of the file's folder inside the package."""
        parts = Path(py_file).resolve().parent.relative_to(PACKAGE).parts
        return "_".join(("ohmloom", *parts))
