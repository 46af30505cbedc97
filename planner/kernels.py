"""The decorator of compiled functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["kernel"]

_F = TypeVar("_F", bound=Callable[..., Any])


def kernel(function: _F) -> _F:
    """Compile a function on first use and keep its machine code in numba's cache.

    Numba renews cached code when the function's own file changes, not when a file changes whose kernels it
    calls.
    """
    return cast(_F, njit(cache=True, error_model="numpy")(function))
