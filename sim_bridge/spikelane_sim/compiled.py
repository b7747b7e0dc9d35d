"""How functions are compiled that only compiled functions call."""

from __future__ import annotations

from collections.abc import Callable
import functools
import sys
from typing import Any

import numba
from numba.np import linalg


def _skip_scipy() -> None:
    """Import the part of Numba that would import SciPy, without SciPy.

    It only looks whether SciPy's BLAS is there, which adds 0.12 s to the 0.6 s of processor time
    that a lap takes to start. No kernel here uses linear algebra; for one that does, Numba looks
    again.
    """
    if 'numba.np.arraymath' in sys.modules:
        return
    look = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath
    finally:
        linalg.ensure_blas = look
    arraymath.ensure_blas = look


_skip_scipy()


def inner(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """Compile a function as `numba.njit(cache=True)` does, but not the way into it from Python.

    That unpacks every array of every argument. For a function that takes the arrays of a fleet it
    takes three times as long to compile as the function itself, and once more with each caller. A
    call from Python would crash; `tests/core/spikelane_sim/test_compiled.py` finds
    such calls.

    Args:
        function: What is decorated.
        options: More options of `numba.njit`.
    """
    return numba.njit(
        function, cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options
    )


@inner
def copy(source, to):  # type: ignore[no-untyped-def]
    """Copy a row into another one of the same length, which is not checked.

    An assignment, `to[:] = source`, also compiles the text of its error for rows of different
    lengths, which takes a second.
    """
    for k in range(len(to)):
        to[k] = source[k]


#: As `inner`, but the function becomes a part of its callers before these are compiled. It is for
#: functions with one caller, since the compiler optimises a function again in each one around it,
#: and for those that return an array on the stack of their caller.
inlined = functools.partial(inner, inline='always')
