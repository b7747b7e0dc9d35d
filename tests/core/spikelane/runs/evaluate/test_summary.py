"""Laps as a whole: what is independent, and repeats of the same drive."""

from __future__ import annotations

from typing import Any

import pytest

from spikelane.runs.evaluate.summary import (
    laps_by_unit,
    MEASURES,
    MEASURES_OF_ALL,
    summarise,
    summarise_by_lane,
    unit_of,
    units_in_words,
)


def lap(seed: int, error_m: float, completed: bool = True, **place: Any) -> dict[str, Any]:
    """Return a lap of the outer lane of scenario 1."""
    others = dict.fromkeys((*MEASURES, *MEASURES_OF_ALL), 1.0)
    own = {'course': '1', 'lane': 'outer', 'seed': seed, 'completed': completed}
    return {**others, 'mean_abs_distance_m': error_m, **own, **place}


def test_a_unit_is_a_training_a_course_or_a_seed() -> None:
    """The first of these that there are several of."""
    assert unit_of([lap(0, 0.1), lap(1, 0.2)]) == 'seed'
    assert unit_of([lap(0, 0.1)]) == 'seed'
    assert unit_of([lap(0, 0.1), lap(0, 0.2, course='2')]) == 'course'
    laps = [lap(0, 0.1, training='a'), lap(0, 0.2, training='b', course='2')]
    assert unit_of(laps) == 'training'


def test_lanes_of_one_seed_are_not_two_draws() -> None:
    """Ten seeds on two lanes: the share of 20 laps is as sure as that of ten draws."""
    laps = [lap(n, 0.01 * n + 0.01, lane=lane) for n in range(10) for lane in ('outer', 'inner')]
    summary = summarise_by_lane(laps)
    share = summary['all']['completed']
    # Wilson's of 10 of 10.
    assert (share['successes'], share['n']) == (20, 20)
    assert share['ci_low'] == pytest.approx(0.722467, abs=1e-6)
    assert (summary['all']['units'], summary['by_lane']['inner']['units']) == (10, 10)
    # The interval of both lanes' mean is that of one lane's.
    error, inner = (
        each['mean_abs_distance_m'] for each in (summary['all'], summary['by_lane']['inner'])
    )
    assert (error['n'], error['units']) == (20, 10)
    assert (error['ci_low'], error['ci_high']) == (inner['ci_low'], inner['ci_high'])


def test_a_unit_is_completed_with_all_its_laps() -> None:
    """Two of three courses, the third with one of its two lanes."""
    laps = [
        lap(0, 0.01, completed=(course, lane) != ('3', 'inner'), course=course, lane=lane)
        for course in '123'
        for lane in ('outer', 'inner')
    ]
    summary = summarise(laps)
    assert summary['unit'] == 'course'
    whole, completed = summary['units_completed'], summary['completed']
    assert (whole['successes'], whole['n']) == (2, 3)
    assert (completed['successes'], completed['n']) == (5, 6)


def test_the_same_drive_with_several_seeds_is_one_draw() -> None:
    """Two of three seeds drove the same on both lanes."""
    laps = [
        lap(seed, error_m, lane=lane)
        for seed, error_m in ((0, 0.02), (1, 0.02), (2, 0.04))
        for lane in ('outer', 'inner')
    ]
    summary = summarise(laps)
    assert (summary['units'], summary['laps'], summary['distinct_laps']) == (2, 6, 4)
    assert summary['completed']['n'] == 4
    assert summary['mean_abs_distance_m']['mean'] == pytest.approx(0.03)
    assert units_in_words(summary) == '2 seeds; 4 distinct of 6 laps driven'
    assert list(laps_by_unit(laps, 'seed')) == [0, 2]
    alone = summarise(laps[:4])
    assert (alone['units'], alone['mean_abs_distance_m']['ci_low']) == (1, None)
    assert units_in_words(alone) == '1 seed; 2 distinct of 4 laps driven'


def test_a_copy_of_a_training_is_no_second_draw() -> None:
    """It drives the same to the last bit; the same numbers on two courses are two draws."""
    assert summarise([lap(0, 0.1), lap(0, 0.1, course='2')])['units'] == 2
    copies = summarise([lap(0, 0.1, training=name) for name in 'ab'])
    assert (copies['units'], copies['distinct_laps']) == (1, 1)
