"""How numbers and their spread are written."""

from spikelane.report.quantities import COUNT, METRES, PERCENT, SIGNED_METRES


def test_an_interval_has_possible_values_only() -> None:
    """Student's t of two values far apart would go below 0, and above all states."""
    # 12.7062 * 50 / 150 = 4.2354, and e^4.2354 = 69.09: 150 / 69.09 and 150 * 69.09.
    assert COUNT.mean([100, 200]) == '150 ± 71 (2 to 10,363)'
    # Odds of 0.93 / 0.07, times and by e^(12.7062 * 0.01 / (0.93 * 0.07)) = e^1.95180.
    assert PERCENT.mean([0.92, 0.94]) == '93.00 ± 1.41 % (65.36 to 98.94)'
    # 4.302653 * 0.01 / sqrt(3) / 0.04 = 0.62103, and e^0.62103 = 1.86085.
    assert METRES.mean([0.03, 0.04, 0.05]) == '0.0400 ± 0.0100 m (0.0215 to 0.0744)'
    # 12.7062 * 0.05 = 0.6353
    assert SIGNED_METRES.mean([-0.1, 0.0]) == '-0.0500 ± 0.0707 m (-0.6853 to 0.5853)'


def test_there_are_as_many_numbers_as_values_allow() -> None:
    """One value has no spread, and none no mean."""
    assert (METRES.mean([0.5]), METRES.median([0.5])) == ('0.5000 m', '0.5000 m')
    assert (METRES.mean([]), METRES.median([])) == ('none', '—')
    assert COUNT.median([3000, 1000, 2500]) == '2,500 (1,000 to 3,000)'


def test_times_that_were_not_reached_are_written_as_later_ones() -> None:
    """The median is Kaplan and Meier's; an interval takes six units."""
    times, reached = [1000, 2000, 3000], [True, False, True]
    # Surviving: 2/3 after 1,000, and 0 after 3,000.
    assert COUNT.median(times, reached) == '3,000 (1,000 to 3,000)'
    assert COUNT.median(times, [True, True, False]) == '2,000 (1,000 to over 3,000)'
    assert COUNT.median(times, [False] * 3) == 'over 3,000 (over 1,000 to over 3,000)'
    assert COUNT.median_interval(times, reached) == '—'
    assert COUNT.median_interval([1, 2, 3, 4, 5], [True] * 5) == '—'
    assert COUNT.median_interval([7] * 6, [True] * 6) == '7 to 7'
    assert COUNT.median_interval([7] * 6, [True, True, True, False, False, False]) == 'from 7'
