"""The pixels of a real sensor."""

import math

import numpy as np
import pytest

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import Events
from spikelane_sim.pixels import EsimParameters, EsimPixels

STEP_NS = 50_000_000

# A pixel's logarithm is that of its intensity plus 0.001, so these are ln 0.1, ln 0.2, ln 0.12.
TENTH, FIFTH, EIGHTH = 0.099, 0.199, 0.119

# From ln 0.1 to ln 0.2 in 50 ms, 0.2 is passed at 0.2 / ln 2 * 50 ms, and so on [us].
RISE_US = [14_427, 28_854, 43_281]


def pixels_of(width: int = 1, height: int = 1, seed: int = 0, **parameters: float) -> EsimPixels:
    """Pixels that are ideal but for what is given, with one image per step."""
    ideal = {'substeps': 1, 'threshold_spread': 0.0, 'leak_rate_hz': 0.0}
    pixels = EsimPixels(EsimParameters(**{**ideal, **parameters}), width, height)
    pixels.reset(np.random.default_rng(seed))
    return pixels


def steps(pixels: EsimPixels, intensities: list[float], step_ns: int = STEP_NS) -> list[Events]:
    """Show one uniform image per step, the first of them new to the pixels."""
    images = [
        np.full((1, pixels.height, pixels.width), intensity, np.float32)
        for intensity in intensities
    ]
    return [pixels.step(image, i * step_ns, (i + 1) * step_ns) for i, image in enumerate(images)]


def times_us(events: Events) -> list[int]:
    """Return the times of events [us]."""
    return [t // 1000 for t in events['t'].tolist()]


def test_a_rise_fires_on_at_each_threshold_on_its_way() -> None:
    """A doubling is 0.693 in the logarithm: three thresholds of 0.2, at interpolated times."""
    silent, events = steps(pixels_of(), [TENTH, FIFTH])
    assert len(silent) == 0
    assert times_us(events) == [50_000 + t for t in RISE_US]
    assert events['polarity'].tolist() == [1, 1, 1]


def test_a_fall_fires_off_at_its_own_threshold() -> None:
    """A halving passes thresholds of 0.3 at 0.3 / ln 2 and 0.6 / ln 2 of the way."""
    _, events = steps(pixels_of(threshold_off=0.3), [FIFTH, TENTH])
    assert times_us(events) == [50_000 + 21_640, 50_000 + 43_281]
    assert events['polarity'].tolist() == [-1, -1]


def test_the_reference_moves_by_the_threshold_and_keeps_the_rest() -> None:
    """After ON at 0.2, 0.4, 0.6 of 0.693, a fall to 0.182 fires OFF at 0.4 and 0.2."""
    _, _, events = steps(pixels_of(), [TENTH, FIFTH, EIGHTH])
    # (0.693147 - 0.4) / 0.510826 and (0.693147 - 0.2) / 0.510826 of 50 ms
    assert times_us(events) == [100_000 + 28_693, 100_000 + 48_270]
    assert events['polarity'].tolist() == [-1, -1]


def test_a_ramp_over_many_images_fires_at_the_times_of_the_ramp() -> None:
    """The logarithm rises by 0.35 in ten images, so 0.1 is passed each 14,285.7 us."""
    pixels = pixels_of(substeps=10, threshold_on=0.1)
    pixels.step(np.full((1, 1, 1), TENTH, np.float32), 0, STEP_NS)
    ramp = 0.1 * np.exp(np.linspace(0.035, 0.35, 10)) - 0.001
    images = ramp.astype(np.float32).reshape(10, 1, 1)
    events = pixels.step(images, STEP_NS, 2 * STEP_NS)
    assert times_us(events) == [50_000 + 14_286, 50_000 + 28_571, 50_000 + 42_857]
    # 0.05 is left over, so 0.05 more fires again: 0.05 of the 0.09 between 5 and 50 ms.
    rest = (0.1 * np.exp(np.linspace(0.35, 0.44, 10)) - 0.001).astype(np.float32)
    (event,) = pixels.step(rest.reshape(10, 1, 1), 2 * STEP_NS, 3 * STEP_NS)
    assert event['t'] == 100_000_000 + 30_000_000


def test_a_full_first_step_starts_at_its_first_image() -> None:
    """With ten images in the first step, the first is the reference and the others count."""
    pixels = pixels_of(substeps=10)
    images = np.full((10, 1, 1), TENTH, np.float32)
    images[5:] = FIFTH
    events = pixels.step(images, 0, STEP_NS)
    # all of the rise lies between 25 and 30 ms, a tenth of RISE_US after 25 ms
    assert times_us(events) == [26_443, 27_885, 29_328]


def test_events_inside_the_refractory_period_are_lost_and_the_reference_moves() -> None:
    """Two events are 14,427 us apart; 14.5 ms suppress the second, and change no later one."""
    _, rise, fall = steps(pixels_of(refractory_s=0.0145), [TENTH, FIFTH, EIGHTH])
    assert times_us(rise) == [50_000 + 14_427, 50_000 + 43_281]
    assert times_us(fall) == [100_000 + 28_693, 100_000 + 48_270]


def test_an_event_at_the_end_of_the_refractory_period_is_kept() -> None:
    """A period of just the events' distance keeps all of them, a microsecond more does not."""
    assert len(steps(pixels_of(refractory_s=0.014427), [TENTH, FIFTH])[1]) == 3
    assert len(steps(pixels_of(refractory_s=0.014428), [TENTH, FIFTH])[1]) == 2


def test_the_refractory_period_is_each_pixel_s_own_and_lasts_over_steps() -> None:
    """The first pixel's last event at 93.3 ms silences its fall's first one at 128.7 ms."""
    pixels = pixels_of(2, 1, refractory_s=0.04)
    pixels.step(np.float32([[[TENTH, FIFTH]]]), 0, STEP_NS)
    pixels.step(np.float32([[[FIFTH, FIFTH]]]), STEP_NS, 2 * STEP_NS)
    events = pixels.step(np.float32([[[EIGHTH, EIGHTH]]]), 2 * STEP_NS, 3 * STEP_NS)
    # first pixel: 64.4 ms fired, so 78.9 and 93.3 ms are lost: 128.7 ms is 64 ms later
    assert [(t // 1000, x) for t, x in events[['t', 'x']].tolist()] == [
        (119_576, 1),  # 0.2 of 0.510826
        (128_693, 0),
    ]


def test_latency_moves_events_into_later_steps() -> None:
    """30 ms later two of three events of a step belong to the next one."""
    rise = steps(pixels_of(latency_s=0.03), [TENTH, FIFTH, FIFTH, FIFTH])
    assert [times_us(events) for events in rise] == [[], [94_427], [108_854, 123_281], []]


def test_latency_longer_than_a_step_and_to_its_very_end() -> None:
    """An event whose shifted time is a step's end belongs to that step."""
    latency_s = 0.085573  # 64,427 us + 85,573 us = 150 ms
    rise = steps(pixels_of(latency_s=latency_s), [TENTH] + 4 * [FIFTH])
    assert [times_us(events) for events in rise] == [[], [], [150_000], [164_427, 178_854], []]


def test_a_reset_drops_events_on_their_way() -> None:
    """Nothing of an episode arrives in the next one."""
    pixels = pixels_of(latency_s=0.2)
    steps(pixels, [TENTH, FIFTH])
    assert len(pixels.pending) == 3
    pixels.reset(np.random.default_rng(0))
    assert [len(events) for events in steps(pixels, 8 * [TENTH])] == 8 * [0]


def test_leak_fires_on_at_its_rate() -> None:
    """4,096 pixels at 10 Hz for 1 s: 40,960 events give or take four times their root."""
    events = np.concatenate(steps(pixels_of(64, 64, leak_rate_hz=10.0), 21 * [0.5]))
    assert abs(len(events) - 40_960) < 4 * 202
    assert set(events['polarity'].tolist()) == {1}
    assert abs(events['x'].mean() - 31.5) < 0.5
    assert abs(events['y'].mean() - 31.5) < 0.5
    per_pixel = np.bincount(events['y'].astype(int) * 64 + events['x'], minlength=4096)
    assert abs(per_pixel.var() / 10.0 - 1.0) < 0.1  # Poisson: the variance is the mean
    in_step_us = (events['t'] // 1000 - 1) % 50_000
    assert abs(in_step_us.mean() - 25_000) < 4 * 14_434 / 202


@pytest.mark.parametrize(('intensity', 'expected'), [(0.0, 40_960), (0.5, 25_600), (1.0, 10_240)])
def test_shot_noise_has_both_polarities_and_grows_in_the_dark(
    intensity: float, expected: int
) -> None:
    """The rate falls linearly to a quarter at white, and half of the events are ON."""
    events = np.concatenate(steps(pixels_of(64, 64, shot_rate_hz=10.0), 21 * [intensity]))
    assert abs(len(events) - expected) < 4 * math.sqrt(expected)
    assert abs((events['polarity'] == 1).mean() - 0.5) < 4 * 0.5 / math.sqrt(expected)


def test_noise_leaves_the_references_alone() -> None:
    """The events of light are the same, at the same times, with noise between them."""
    _, noisy = steps(pixels_of(8, 8, leak_rate_hz=100.0, shot_rate_hz=100.0), [TENTH, FIFTH])
    found = [t for t in times_us(noisy) if t - 50_000 in RISE_US]
    assert len(noisy) > 3 * 64 + 300
    assert len(found) == 3 * 64


def test_noise_is_refractory_too() -> None:
    """No pixel fires twice within 20 ms, at a rate of one event per millisecond."""
    noisy = pixels_of(4, 4, leak_rate_hz=1000.0, refractory_s=0.02)
    events = np.concatenate(steps(noisy, 11 * [0.5]))
    for x in range(4):
        for y in range(4):
            t = events['t'][(events['x'] == x) & (events['y'] == y)]
            assert len(t) > 15
            assert np.diff(t).min() >= 20_000_000


def test_thresholds_spread_from_pixel_to_pixel_about_their_mean() -> None:
    """16,384 draws: the mean within four standard errors, the spread within 3 %."""
    pixels = pixels_of(128, 128, threshold_on=0.3, threshold_off=0.2, threshold_spread=0.03)
    on, off = pixels.pixels.threshold_on.copy(), pixels.pixels.threshold_off
    assert abs(on.mean() - 0.3) < 4 * 0.03 / 128
    assert abs(off.mean() - 0.2) < 4 * 0.03 / 128
    assert abs(on.std() / 0.03 - 1) < 0.03
    assert abs(off.std() / 0.03 - 1) < 0.03
    assert abs(np.corrcoef(on, off)[0, 1]) < 0.04
    pixels.reset(np.random.default_rng(1))
    assert not np.array_equal(pixels.pixels.threshold_on, on)
    pixels.reset(np.random.default_rng(0))
    assert np.array_equal(pixels.pixels.threshold_on, on)


def test_a_wide_spread_leaves_every_pixel_a_threshold_of_a_hundredth() -> None:
    """Where the draw is smaller, or negative, 0.01 holds."""
    pixels = pixels_of(64, 64, threshold_spread=1.0)
    assert pixels.pixels.threshold_on.min() == 0.01
    assert pixels.pixels.threshold_off.min() == 0.01


def test_from_black_to_white_the_number_of_events_is_bounded() -> None:
    """With ln 1001 = 6.909, the least threshold gives 690 events in each of 100 pixels."""
    _, events = steps(pixels_of(10, 10, threshold_on=0.01), [0.0, 1.0])
    assert len(events) == 69_000
    assert set(np.bincount(events['y'].astype(int) * 10 + events['x']).tolist()) == {690}


@pytest.mark.parametrize('intensity', [1.0, 1e30, math.inf])
def test_a_pixel_fires_at_most_once_per_microsecond(intensity: float) -> None:
    """In 5 us there are five events of 690; the others are lost, not late.

    The reference is white then: grey, which is 0.692 less, fires three times.
    """
    seen = steps(pixels_of(threshold_on=0.01), [0.0, intensity, intensity, 0.5], 5000)
    assert [events['polarity'].tolist() for events in seen] == [[], 5 * [1], [], 3 * [-1]]


def test_intensities_beyond_black_and_white_count_as_these() -> None:
    """Below 0, not-a-number and above 1: no events from what is clipped away."""
    rise = steps(pixels_of(), [0.0, -1.0, math.nan, 0.0, 1.0, 7.0])
    assert [len(events) for events in rise] == [0, 0, 0, 0, 34, 0]
    assert [len(events) for events in steps(pixels_of(), [math.nan, 0.0])] == [0, 0]


def test_events_of_one_pixel_at_one_microsecond_keep_their_order() -> None:
    """Up and down again within a microsecond is ON, then OFF."""
    pixels = pixels_of(50, 1, substeps=2, threshold_on=0.5, threshold_off=0.5)
    pixels.step(np.full((1, 1, 50), TENTH, np.float32), 0, 1000)
    there_and_back = np.float32([50 * [FIFTH], 50 * [0.05]]).reshape(2, 1, 50)
    events = pixels.step(there_and_back, 1000, 2000)
    assert set(events['t'].tolist()) == {2000}
    assert events['x'].tolist() == np.repeat(np.arange(50), 2).tolist()
    assert events['polarity'].tolist() == 50 * [1, -1]


def test_a_step_that_leaves_a_gap_is_refused() -> None:
    """Light between steps cannot be known."""
    pixels = pixels_of()
    steps(pixels, [0.5])
    with pytest.raises(SpikelaneError, match='to start where the last one ended, at 50000000 ns'):
        pixels.step(np.zeros((1, 1, 1), np.float32), STEP_NS + 1000, 2 * STEP_NS)


def test_only_the_first_step_may_bring_a_single_image() -> None:
    """Later steps want all of their images."""
    pixels = pixels_of(substeps=10)
    steps(pixels, [0.5])
    with pytest.raises(
        SpikelaneError, match=r'shape \(10, 1, 1\), got float32 of shape \(1, 1, 1'
    ):
        pixels.step(np.zeros((1, 1, 1), np.float32), STEP_NS, 2 * STEP_NS)


def test_hot_pixels_are_a_cameras_own_and_fire_at_their_rate() -> None:
    """5 of 100 pixels at 200 Hz, the same ones in all episodes; other cameras have others."""
    places = []
    for seed, hot_seed in ((1, 7), (2, 7), (1, 8)):
        pixels = pixels_of(10, 10, seed, hot_share=0.05, hot_rate_hz=200.0, hot_seed=hot_seed)
        events = np.concatenate(steps(pixels, [FIFTH] * 41))
        counts = np.bincount(events['y'].astype(int) * 10 + events['x'], minlength=100)
        assert np.count_nonzero(counts) == 5
        assert abs(counts.sum() - 2050) < 200  # 2.05 s
        assert 0.4 < np.mean(events['polarity'] > 0) < 0.6
        places.append(np.flatnonzero(counts).tolist())
    assert places[0] == places[1] != places[2]
