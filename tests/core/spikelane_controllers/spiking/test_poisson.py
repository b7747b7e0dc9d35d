"""Poisson spikes: rates by hand, statistics at a fixed seed."""

from __future__ import annotations

import numpy as np
import pytest

from spikelane_controllers.spiking.poisson import (
    firing_rates,
    poisson_spikes,
    PoissonParameters,
)


def test_rates_are_proportional_to_events_and_clipped() -> None:
    """300 Hz at 15 events: 20 Hz for each, in the order of rows, then columns."""
    counts = np.array([[0, 1, 5], [15, 16, 200]])
    assert firing_rates(counts, PoissonParameters()).tolist() == [0, 20, 100, 300, 300, 300]


def test_other_scales_are_parameters() -> None:
    """500 Hz at 10 events."""
    parameters = PoissonParameters(max_rate_hz=500.0, max_events=10)
    assert firing_rates(np.array([[3, 10, 11]]), parameters).tolist() == [150, 500, 500]


def test_counts_are_poisson_numbers_of_the_rate() -> None:
    """Mean and variance of 20,000 windows are rate times 50 ms, within 5 standard errors."""
    rng = np.random.default_rng(0)
    rates_hz = np.array([0.0, 20.0, 500.0, 0.0, 100.0, 0.0])
    counts = np.array(
        [np.bincount(poisson_spikes(rates_hz, rng)['source'], minlength=6) for _ in range(20_000)]
    )
    for source, mean in enumerate([0.0, 1.0, 25.0, 0.0, 5.0, 0.0]):
        error = np.sqrt(mean / 20_000)
        assert counts[:, source].mean() == pytest.approx(mean, abs=5 * error)
        spread = np.sqrt((mean + 2 * mean**2) / 20_000)
        assert counts[:, source].var() == pytest.approx(mean, abs=5 * spread)


def test_inputs_are_independent() -> None:
    """Counts of two inputs do not correlate."""
    rng = np.random.default_rng(1)
    rates_hz = np.array([200.0, 300.0])
    counts = [
        np.bincount(poisson_spikes(rates_hz, rng)['source'], minlength=2) for _ in range(10_000)
    ]
    assert abs(np.corrcoef(np.transpose(counts))[0, 1]) < 0.04


def test_times_are_uniform() -> None:
    """Chi-squared over the 500 grid steps: 499 degrees, mean 499, standard deviation 31.6."""
    drawn = poisson_spikes(np.array([4000.0, 0.0, 900_000.0]), np.random.default_rng(2))
    numbers = np.bincount(drawn['step'][drawn['source'] == 2], minlength=500)
    assert len(numbers) == 500
    chi_squared = ((numbers - numbers.mean()) ** 2).sum() / numbers.mean()
    assert 499 - 5 * 31.6 < chi_squared < 499 + 5 * 31.6


def test_spikes_are_in_the_order_of_grid_steps_inside_the_window() -> None:
    """The first and last grid step both occur."""
    rng = np.random.default_rng(3)
    steps = poisson_spikes(np.array([500.0, 0.0, 900.0]), rng)['step']
    many = poisson_spikes(np.array([50_000.0]), rng, window=20)['step']
    assert np.all(np.diff(steps) >= 0)
    assert np.all(np.diff(many) >= 0)
    assert (many.min(), many.max()) == (0, 19)


@pytest.mark.parametrize('mean', [10, 48, 300])
def test_spikes_are_in_a_stable_order_however_many(mean: int) -> None:
    """The order is NumPy's: by grid steps, then in the order in which the numbers were drawn."""
    rates_hz = np.array([0.25, 0.5, 0.25]) * mean / 0.005
    for seed in range(20):
        drawn = poisson_spikes(rates_hz, np.random.default_rng(seed), window=50)
        rng = np.random.default_rng(seed)
        places = 4 * rng.random(rng.poisson(mean))
        sources = np.digitize(places, [1, 3])
        steps = (
            50 * (places - np.array([0, 1, 3])[sources]) / np.array([1, 2, 1])[sources]
        ).astype(int)
        order = np.argsort(steps, kind='stable')
        assert drawn['step'].tolist() == steps[order].tolist()
        assert drawn['source'].tolist() == sources[order].tolist()


def test_a_shorter_window_has_fewer_spikes() -> None:
    """2 ms at 100,000 Hz: 200 spikes, give or take 5 standard deviations."""
    drawn = poisson_spikes(np.array([100_000.0]), np.random.default_rng(4), window=20)
    assert len(drawn) == pytest.approx(200, abs=71)


def test_no_rate_gives_no_spikes() -> None:
    """Silence of all inputs is allowed."""
    assert not len(poisson_spikes(np.zeros(32), np.random.default_rng(5)))


def test_the_same_seed_gives_the_same_spikes() -> None:
    """Bit for bit, and another seed gives others."""
    rates_hz = np.array([10.0 * source for source in range(32)])
    first = poisson_spikes(rates_hz, np.random.default_rng(6))
    again = poisson_spikes(rates_hz, np.random.default_rng(6))
    other = poisson_spikes(rates_hz, np.random.default_rng(7))
    assert first.tobytes() == again.tobytes()
    assert first.tobytes() != other.tobytes()
    assert rates_hz.tolist() == [10.0 * source for source in range(32)]


def test_in_a_shorter_step_fewer_events_are_the_largest_rate() -> None:
    """In 10 ms 3 events are as 15 in 50 ms; one makes a third of the rate."""
    counts = np.array([[0, 1, 3, 9]])
    assert firing_rates(counts, PoissonParameters(), 0.2).tolist() == [0, 100, 300, 300]
