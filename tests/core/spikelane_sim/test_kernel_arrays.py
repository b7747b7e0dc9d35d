"""Arrays without an owner, and on the stack."""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_sim.kernel_arrays import borrowed, stack_array


class Inner(NamedTuple):
    """A tuple in a tuple."""

    rows: NDArray[np.float64]
    factor: int


class Outer(NamedTuple):
    """Arrays, a number and a tuple."""

    counts: NDArray[np.int64]
    inner: Inner
    shift: float


@numba.njit
def change(outer):  # type: ignore[no-untyped-def]
    """Return a sum of everything, and write to an array."""
    outer = borrowed(outer)
    row = outer.inner.rows[1]
    row[0] += 1.0
    return row.sum() * outer.inner.factor + outer.counts[-1] + outer.shift


@numba.njit
def own_less(array):  # type: ignore[no-untyped-def]
    """Return an array that nobody owns in the kernel."""
    return borrowed(array)[1:].copy()


def test_a_kernel_reads_and_writes_the_callers_arrays() -> None:
    """Also those in tuples in tuples; Python's references are neither lost nor kept."""
    outer = Outer(np.array([3, 4]), Inner(np.array([[1.0, 2.0], [3.0, 5.0]]), 10), 0.5)
    for calls in range(1, 200):
        assert change(outer) == (8.0 + calls) * 10 + 4 + 0.5
    assert outer.inner.rows.tolist() == [[1.0, 2.0], [202.0, 5.0]]
    assert outer.counts.tolist() == [3, 4]


def test_what_is_made_of_them_is_owned() -> None:
    """A copy outlives the kernel and the array it was made of."""
    array = np.arange(1000)
    copies = [own_less(array) for _ in range(100)]
    del array
    assert all(np.array_equal(copy, np.arange(1, 1000)) for copy in copies)


def test_what_has_other_references_cannot_be_borrowed() -> None:
    """As the memory of a text or a list, whose count would be wrong."""

    @numba.njit
    def borrow(value):  # type: ignore[no-untyped-def]
        return len(borrowed(value)[0])

    expected = 'value: expected arrays, numbers and tuples of them, got unicode_type'
    with pytest.raises(numba.TypingError, match=expected):
        borrow(('text', 1))


@numba.njit
def fill_row(row, value):  # type: ignore[no-untyped-def]
    """Write to an array of the caller, with one of its own in between."""
    own = stack_array((3,), np.float64)
    for k in range(len(own)):
        own[k] = value + k
    row[:] = own


@numba.njit
def sum_on_stack(times):  # type: ignore[no-untyped-def]
    """Return sums of arrays on the stack, which functions fill again and again."""
    table, counts = stack_array((2, 3), np.float64), stack_array((2,), np.int32)
    counts[:] = 0
    total = 0.0
    for _ in range(times):
        for i in range(2):
            fill_row(table[i], 10.0 * i)
            counts[i] += len(table[i])
        total += table.sum()
    return total, counts[0], counts[1], table.shape, table[1, 2]


def test_an_array_on_the_stack_is_one_of_the_function() -> None:
    """Each call has its own; however often it is filled, the stack does not grow."""
    # 0 + 1 + 2 + 10 + 11 + 12 = 36
    assert sum_on_stack(1) == (36.0, 3, 3, (2, 3), 12.0)
    assert sum_on_stack(1_000_000) == (36e6, 3_000_000, 3_000_000, (2, 3), 12.0)


def test_the_size_of_an_array_on_the_stack_must_be_known() -> None:
    """The stack is small, so that sizes stand in the text."""

    @numba.njit
    def of_any_size(size):  # type: ignore[no-untyped-def]
        return stack_array((size,), np.float64)[0]

    with pytest.raises(numba.TypingError, match='shape: expected a tuple of integer literals'):
        of_any_size(3)
