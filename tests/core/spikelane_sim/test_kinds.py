"""Values of files checked against annotations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypedDict

import pytest

from spikelane_sim.kinds import check_kind, KindError


class Point(NamedTuple):
    """A mapping with these fields and no others."""

    x: int
    y: float = 0.0


class Base(TypedDict):
    """Fields that are required."""

    name: str
    points: list[Point]


class Row(Base, total=False):
    """Fields that may be missing."""

    share: float | None
    others: Mapping[str, Any]


GOOD: dict[str, Any] = {'name': 'a', 'points': [{'x': 1}], 'more': object}


@pytest.mark.parametrize(
    ('value', 'kind'),
    [
        (GOOD, Row),
        ({**GOOD, 'share': None, 'others': {'a': [object]}}, Row),
        (2, float),
        (-(2**63) + 1, int),
        ('', str | None),
        ({'a': {'b': [1, 'c', True, None]}}, dict[str, dict[str, list[int | str | bool | None]]]),
    ],
)
def test_a_value_of_the_kind_is_returned(value: Any, kind: Any) -> None:
    """As it is; a whole number is a number too."""
    assert check_kind(value, kind) is value


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'name': 1}, 'name: expected a text, got 1'),
        ({'points': {}}, 'points: expected a list, got {}'),
        ({'points': [{'x': 1}, 3]}, r'points\[1\]: expected names and values, got 3'),
        ({'points': [{'x': True}]}, r'points\[0\].x: expected a whole number, got True'),
        ({'points': [{'x': 10**400}]}, r'points\[0\].x: expected a whole number, got one beyond'),
        ({'points': [{}]}, r'points\[0\].x: expected a whole number, got none: is the file of'),
        ({'points': [{'x': 1, 'z': 2}]}, r'points\[0\].z: expected one of x, y'),
        ({'share': 'a'}, "share: expected a number or nothing, got 'a'"),
        ({'share': float('nan')}, 'share: expected a number or nothing, got nan'),
        ({'share': -1e100}, r'share: expected a number or nothing, got -1e\+100'),
        ({'share': float('inf')}, 'share: expected a number or nothing, got inf'),
        ({'others': {2: 1}}, 'others.2: expected names for keys, got 2'),
    ],
)
def test_the_innermost_value_that_is_of_another_kind_is_named(
    change: dict[str, Any], message: str
) -> None:
    """With what was expected and what came."""
    with pytest.raises(KindError, match=f'^{message}'):
        check_kind({**GOOD, **change}, Row)


def test_a_field_that_is_missing_is_named() -> None:
    """Also where it is the whole file that is none."""
    with pytest.raises(KindError, match=r'^name: expected a text, got none: is the file of'):
        check_kind({'points': []}, Row)
    with pytest.raises(KindError, match=r'^expected names and values, got \[\]$'):
        check_kind([], Row)
