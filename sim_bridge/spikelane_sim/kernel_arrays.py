"""Arrays that cost a kernel nothing: without an owner, or on the stack.

numba counts the references to an array with atomic instructions, wherever a function takes an
array out of a tuple or hands it on, and a small new array takes longer to allocate than to fill.
In the kernel of a fleet the counts alone took a sixth of the time, and threads that share arrays,
as those of a `World`, wait for each other at them. A kernel that is called from Python, which
keeps the arrays as long as the call lasts, needs no counting.
"""

from __future__ import annotations

import math
from typing import Any

from numba.core import cgutils, errors, types
from numba.core.imputils import impl_ret_new_ref
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array


@intrinsic
def borrowed(typing_context: Any, value: Any) -> Any:
    """Return, inside a kernel, the same arrays without an owner, also those in tuples.

    Args:
        typing_context: Numba's.
        value: An array, or a tuple of arrays, numbers and such tuples, which the caller keeps.
    """
    _check_countless(value)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        found = _without_owner(context, builder, signature.args[0], arguments[0])
        return impl_ret_new_ref(context, builder, signature.return_type, found)

    return value(value), generate


def _check_countless(kind: Any) -> None:
    """Check that a value has no references but those of arrays, of which `borrowed` takes care."""
    if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]  # numba has it
        for each in tuple(kind):
            _check_countless(each)
    elif kind != types.none and not isinstance(kind, types.Array | types.Number | types.Boolean):
        raise errors.TypingError(f'value: expected arrays, numbers and tuples of them, got {kind}')


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


@intrinsic(prefer_literal=True)
def stack_array(typing_context: Any, shape: Any, dtype: Any) -> Any:
    """Return, inside a kernel, an uninitialised array that is gone when the function returns.

    It must not be kept anywhere, nor be returned, but by an `inlined` function, whose arrays are
    those of its caller.

    Args:
        typing_context: Numba's.
        shape: A tuple of integer literals: at most a few hundred values.
        dtype: Type of its values, as `np.float64`.
    """
    sizes = tuple(shape) if isinstance(shape, types.BaseTuple) else ()  # type: ignore[attr-defined]
    if not sizes or not all(isinstance(each, types.IntegerLiteral) for each in sizes):
        raise errors.TypingError(f'shape: expected a tuple of integer literals, got {shape}')
    lengths = [each.literal_value for each in sizes]
    kind = types.Array(dtype.dtype, len(lengths), 'C')

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(kind)(context, builder)
        value_type = context.get_data_type(kind.dtype)
        n_bytes = context.get_abi_sizeof(value_type)
        place = cgutils.alloca_once(builder, value_type, math.prod(lengths))
        strides = [math.prod(lengths[i + 1 :]) * n_bytes for i in range(len(lengths))]
        populate_array(
            array,
            data=place,
            shape=[context.get_constant(types.intp, each) for each in lengths],
            strides=[context.get_constant(types.intp, each) for each in strides],
            itemsize=context.get_constant(types.intp, n_bytes),
            meminfo=None,
            parent=None,
        )
        return array._getvalue()

    return kind(shape, dtype), generate
