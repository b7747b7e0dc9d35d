"""How numbers and their spread are written."""

from spikelane.report.quantities import COUNT, METRES, PERCENT, SIGNED_METRES


def test_an_interval_has_possible_values_only() -> None:
    """Student's t of two values far apart would go below 0, and above all states."""
    # 12.7062 * 100 / sqrt(2) * sqrt(2) / sqrt(2) = 12.7062 * 50 = 635.3 about 150
    assert COUNT.mean([100, 200]) == '150 ± 71 (0 to 785)'
    assert PERCENT.mean([0.5, 1.0]) == '75.00 ± 35.36 % (0.00 to 100.00)'
    # 12.7062 * 0.05 = 0.6353
    assert METRES.mean([0.0, 0.1]) == '0.0500 ± 0.0707 m (0.0000 to 0.6853)'
    assert SIGNED_METRES.mean([-0.1, 0.0]) == '-0.0500 ± 0.0707 m (-0.6853 to 0.5853)'


def test_there_are_as_many_numbers_as_values_allow() -> None:
    """One value has no spread, and none no mean."""
    assert (METRES.mean([0.5]), METRES.median([0.5])) == ('0.5000 m', '0.5000 m')
    assert (METRES.mean([]), METRES.median([])) == ('none', '—')
    assert COUNT.median([3000, 1000, 2500]) == '2,500 (1,000 to 3,000)'
