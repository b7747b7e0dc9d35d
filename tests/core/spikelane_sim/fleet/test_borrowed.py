"""Arrays that a kernel uses without counting references to them."""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.fleet.borrowed import borrowed


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
