"""How functions are compiled that only compiled functions call."""

from __future__ import annotations

from collections.abc import Callable
import functools
import sys
from typing import Any

import numba
from numba.core import errors, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import FunctionPass, PassManager, register_pass
from numba.core.typed_passes import NopythonTypeInference
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
    options = {'_nrt': True, **options}
    return numba.njit(
        function, cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options
    )


def _has_arrays(kind: Any) -> bool:
    """Tell whether values of one of Numba's types have references that are counted."""
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]  # numba has it
        return any(map(_has_arrays, kind))
    return isinstance(kind, types.Array)


@register_pass(mutates_CFG=False, analysis_only=True)
class _CheckUncounted(FunctionPass):
    """Refuse what `uncounted` functions must not do and Numba does not notice."""

    _name = 'check_uncounted'

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        name = state.func_id.func_name
        if _has_arrays(state.return_type):
            raise errors.TypingError(f'{name}: expected no array to be returned (`uncounted`)')
        for call, signature in state.calltypes.items():
            if getattr(call, 'op', None) != 'call':
                continue
            kind = state.typemap[call.func.name]
            if not isinstance(kind, types.Dispatcher):
                continue
            # Without an option of its own, a function would be compiled without counting as well,
            # and other callers would get the same.
            options = getattr(kind.dispatcher, 'targetoptions', {})
            if _has_arrays(signature.return_type) or '_nrt' not in options:
                raise errors.TypingError(
                    f'{name}: expected calls of `inner` and `uncounted` functions that return no '
                    f'array, got one of {kind.dispatcher.py_func.__name__}'
                )
        return False


class _Uncounted(CompilerBase):
    """Numba's way to compile a function, and the check."""

    def define_pipelines(self) -> list[PassManager]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_CheckUncounted, NopythonTypeInference)
        passes.finalize()
        return [passes]


#: As `inner`, for a function that makes no arrays, returns none, and calls only `inner` and
#: `uncounted` functions, which return none either. All this is checked. Its caller keeps the
#: arrays that it works with, and so it counts no references to them. In the kernel of a fleet,
#: counting them at the beginning and end of small functions took a twentieth of the time, though
#: none of these arrays has an owner.
uncounted = functools.partial(inner, _nrt=False, pipeline_class=_Uncounted)


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
