"""Random generators of many robots in one kernel: NumPy's own, chosen by their states' addresses.

numba takes a `numpy.random.Generator` as an argument, but no array of them. All PCG64 generators
differ in nothing but the place of their state, so a kernel is given one of them, and the places of
the others' states; `generator_at` puts them together. What is drawn are the numbers that NumPy
draws, and the states are those that NumPy has afterwards.
"""

from __future__ import annotations

from typing import Any

from numba.core import cgutils, types
from numba.core.imputils import impl_ret_borrowed
from numba.extending import intrinsic
import numpy as np

#: Only its type counts: whatever a kernel draws comes from a state in `Generators`.
TEMPLATE = np.random.default_rng(0)


class Generators:
    """A generator for each robot.

    Attributes:
        addresses: Where their states are, (n_robots,); 0 for a robot that has none.
    """

    def __init__(self, n_robots: int) -> None:
        self.addresses = np.zeros(n_robots, np.uintp)
        self._kept: list[np.random.Generator | None] = [None] * n_robots

    def __getitem__(self, robot: int) -> np.random.Generator:
        """Return the generator of a robot, which must have one."""
        found = self._kept[robot]
        assert found is not None
        return found

    def __setitem__(self, robot: int, generator: np.random.Generator) -> None:
        """Give a robot a generator."""
        bits = generator.bit_generator
        assert isinstance(bits, np.random.PCG64)  # as TEMPLATE's
        self._kept[robot] = generator  # or its state's memory would be gone
        self.addresses[robot] = bits.ctypes.state_address


@intrinsic
def generator_at(typing_context: Any, template: Any, address: Any) -> Any:
    """Return, inside a kernel, the generator whose state is at an address.

    Args:
        typing_context: Numba's.
        template: A generator of the same kind.
        address: Address of the state, as `Generators.addresses` has it; never 0.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.args[0]
        generator = cgutils.create_struct_proxy(kind)(context, builder, value=arguments[0])
        bits_kind = types.NumPyRandomBitGeneratorType('NumPyRandomBitGeneratorType')
        bits = cgutils.create_struct_proxy(bits_kind)(
            context, builder, value=generator.bit_generator
        )
        bits.state_address = arguments[1]
        bits.state = arguments[1]
        generator.bit_generator = bits._getvalue()
        return impl_ret_borrowed(context, builder, kind, generator._getvalue())

    if not isinstance(template, types.NumPyRandomGeneratorType):
        return None
    return template(template, types.uintp), generate
