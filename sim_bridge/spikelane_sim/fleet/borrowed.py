"""Arrays that a kernel uses without counting who uses them.

numba counts the references to an array with atomic instructions, wherever a function takes an
array out of a tuple or hands it on. Threads that share arrays, as those of a `World`, wait for
each other at these counts. A kernel that is called from Python, which keeps the arrays as long
as the call lasts, needs no counting.
"""

from __future__ import annotations

from typing import Any

from numba.core import cgutils, types
from numba.core.imputils import impl_ret_new_ref
from numba.extending import intrinsic


@intrinsic
def borrowed(typing_context: Any, value: Any) -> Any:
    """Return, inside a kernel, the same arrays without an owner, also those in tuples.

    Args:
        typing_context: Numba's.
        value: An array, or a tuple of arrays, numbers and such tuples, which the caller keeps.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found = _without_owner(context, builder, signature.args[0], arguments[0])
        return impl_ret_new_ref(context, builder, signature.return_type, found)

    return value(value), generate


def _without_owner(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        for name in ('meminfo', 'parent'):
            setattr(array, name, cgutils.get_null_value(getattr(array, name).type))
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]  # numba has it
        for index, each in enumerate(tuple(kind)):
            part = builder.extract_value(value, index)
            part = _without_owner(context, builder, each, part)
            value = builder.insert_value(value, part, index)
    return value
