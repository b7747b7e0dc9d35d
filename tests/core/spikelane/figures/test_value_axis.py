"""The axis of values that were tried: when it is logarithmic, and where zero stands on it."""

from __future__ import annotations

import pytest

from spikelane.figures.value_axis import ValueAxis
from spikelane_sim import figure_style as style


@pytest.mark.parametrize(
    ('values', 'is_log'),
    [
        ([0.1, 2.0], True),
        ([0.1, 1.9], False),
        ([0.0, 0.1, 2.0], True),
        ([0.0, 100.0], False),
        ([-0.1, 0.1, 5.0], False),
        ([0.0], False),
    ],
)
def test_the_axis_is_logarithmic_from_a_factor_of_20_on(values: list[float], is_log: bool) -> None:
    """A value below zero has no place on such an axis; zero has one to the left of all others."""
    axis = ValueAxis.of(values)
    assert axis.is_log == is_log
    assert axis.named('rate [Hz]') == ('rate [Hz], log scale' if is_log else 'rate [Hz]')
    if is_log:
        assert 0 < axis.place(0.0) < 0.1 or axis.zero_at is None
    else:
        assert [axis.place(value) for value in values] == values


def test_ticks_stand_at_values_that_were_tried() -> None:
    """At all of eight, and at every second of sixteen, the first among them."""
    for count, labels in ((8, '0 1 2 3 4 5 6 7'), (16, '0 2 4 6 8 10 12 14')):
        with style.settings():
            axes = style.new_figure(4, 3).add_subplot()
            ValueAxis.of(range(count)).set_up(axes)
        assert ' '.join(text.get_text() for text in axes.get_xticklabels()) == labels
