"""The pixels of the paper's simulation."""

from collections.abc import Callable

import numpy as np
import pytest

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import Events
from spikelane_sim.pixels import CoppeliaParameters, CoppeliaPixels

STEP_NS = 50_000_000


def pixels_of(width: int, height: int, **parameters: float) -> CoppeliaPixels:
    """Return pixels that are ready for their first image."""
    pixels = CoppeliaPixels(CoppeliaParameters(**parameters), width, height)
    pixels.reset(np.random.default_rng(0))
    return pixels


def polarities(intensities: list[float], **parameters: float) -> list[int]:
    """What a single pixel says to each of these intensities, 0 for nothing."""
    pixels = pixels_of(1, 1, **parameters)
    said = []
    for step, intensity in enumerate(intensities):
        image = np.full((1, 1, 1), intensity, np.float32)
        events = pixels.step(image, step * STEP_NS, (step + 1) * STEP_NS)
        said.append(int(events['polarity'].sum()))
        assert len(events) <= 1
    return said


@pytest.mark.parametrize(
    ('reference', 'intensity', 'expected'),
    [
        (0.5, 0.55, 1),  # 0.55 in float32 is just above
        (0.5, 0.5499999, 0),
        (0.5, 0.45, -1),
        (0.5, 0.4500001, 0),
        (0.625, 0.6875, 1),  # exactly a tenth more, and exact in binary
        (0.625, 0.5625, -1),  # exactly a tenth less
        (0.2, 0.22, 0),  # float32 makes 0.2 a little more and 0.22 a little less
        (1.0, 0.9, -1),
    ],
)
def test_a_pixel_fires_at_a_tenth_of_its_reference_and_not_below(
    reference: float, intensity: float, expected: int
) -> None:
    """The change counts as the difference of the float32 intensities, exactly."""
    assert polarities([reference, intensity]) == [0, expected]


def test_black_counts_as_a_thousandth() -> None:
    """From black, 0.0001 is a tenth; black that stays black is silent."""
    assert polarities([0.0, 0.0, 0.00009, 0.00011, 0.0]) == [0, 0, 0, 1, -1]
    assert polarities([0.0, 0.04, 0.06], dark_intensity=0.5) == [0, 0, 1]


def test_small_changes_add_up_until_the_pixel_fires() -> None:
    """The reference stays while a pixel is silent, and becomes the intensity when it fires."""
    assert polarities([0.5, 0.52, 0.54, 0.56, 0.6, 0.62]) == [0, 0, 0, 1, 0, 1]


def test_a_pixel_fires_once_per_step_however_large_the_change() -> None:
    """From 0.01 to 1 is a hundredfold rise and one event, and nothing is owed afterwards."""
    assert polarities([0.01, 1.0, 1.0]) == [0, 1, 0]


def test_the_threshold_is_a_parameter() -> None:
    """At half the reference, 0.7 is silent after 0.5, and 0.75 fires."""
    assert polarities([0.5, 0.7, 0.75], threshold=0.5) == [0, 0, 1]


def test_events_are_at_the_step_s_end_row_by_row() -> None:
    """Row 0 is the top one; within it columns from the left."""
    pixels = pixels_of(3, 2)
    pixels.step(np.full((1, 2, 3), 0.5, np.float32), 0, STEP_NS)
    image = np.float32([[[0.5, 0.9, 0.1], [0.9, 0.5, 0.5]]])
    events = pixels.step(image, STEP_NS, 2 * STEP_NS)
    assert events[['t', 'x', 'y', 'polarity']].tolist() == [
        (100_000_000, 1, 0, 1),
        (100_000_000, 2, 0, -1),
        (100_000_000, 0, 1, 1),
    ]


@pytest.mark.parametrize(('width', 'height'), [(128, 128), (64, 1), (63, 1), (13, 7), (200, 3)])
def test_random_images_give_what_whole_numbers_give(width: int, height: int) -> None:
    """Intensities of k/256 make the rule one of integers: ten times the change >= reference."""
    rng = np.random.default_rng(width)
    pixels = pixels_of(width, height)
    reference = rng.integers(0, 257, (height, width))
    pixels.step((reference[None] / 256).astype(np.float32), 0, STEP_NS)
    for step in range(1, 20):
        seen = np.clip(reference + rng.integers(-12, 13, reference.shape), 0, 256)
        events = pixels.step(
            (seen[None] / 256).astype(np.float32), step * STEP_NS, (step + 1) * STEP_NS
        )
        change = seen - reference
        fires = (10 * abs(change) >= reference) & (change != 0)
        rows, columns = np.nonzero(fires)
        assert events['y'].tolist() == rows.tolist()
        assert events['x'].tolist() == columns.tolist()
        assert events['polarity'].tolist() == np.sign(change[fires]).tolist()
        reference = np.where(fires, seen, reference)


def test_events_returned_stay_as_they_were() -> None:
    """A later step does not write into the events of an earlier one."""
    pixels = pixels_of(1, 1)
    pixels.step(np.float32([[[0.5]]]), 0, STEP_NS)
    first = pixels.step(np.float32([[[0.9]]]), STEP_NS, 2 * STEP_NS)
    pixels.step(np.float32([[[0.1]]]), 2 * STEP_NS, 3 * STEP_NS)
    assert first.tolist() == [(100_000_000, 0, 0, 1)]


def test_not_a_number_is_silent() -> None:
    """A pixel without a value says nothing, and goes on with its reference."""
    assert polarities([0.5, float('nan'), 0.51, 0.6]) == [0, 0, 0, 1]


def test_more_than_one_image_is_refused() -> None:
    """The model has no times inside a step."""
    with pytest.raises(SpikelaneError, match=r'shape \(1, 1, 1\), got float32 of shape \(2, 1, 1'):
        pixels_of(1, 1).step(np.zeros((2, 1, 1), np.float32), 0, STEP_NS)


def noisy_pixels(rate_hz: float, seed: int = 0) -> CoppeliaPixels:
    """Return 100 x 50 pixels that have seen grey."""
    pixels = CoppeliaPixels(CoppeliaParameters(noise_rate_hz=rate_hz), 100, 50)
    pixels.reset(np.random.default_rng(seed))
    first = pixels.step(np.full((1, 50, 100), 0.5, np.float32), 0, STEP_NS)
    assert len(first) == 0
    return pixels


def test_noise_comes_at_its_rate_on_as_often_as_off(
    check_events: Callable[[Events, int, int], None],
) -> None:
    """2 Hz of 5,000 pixels are 500 events in a step; one per pixel at most leaves 475.8."""
    pixels, grey = noisy_pixels(2.0), np.full((1, 50, 100), 0.5, np.float32)
    steps = [pixels.step(grey, n * STEP_NS, (n + 1) * STEP_NS) for n in range(1, 101)]
    assert np.mean([len(events) for events in steps]) == pytest.approx(475.8, rel=0.01)
    assert abs(np.mean(np.concatenate([events['polarity'] for events in steps]))) < 0.02
    for n, events in enumerate(steps, 1):
        check_events(events, 100, 50)
        assert set(events['t'].tolist()) == {(n + 1) * STEP_NS}
        places = events['y'] * 100 + events['x'].astype(int)
        assert (np.diff(places) > 0).all()


def test_noise_takes_no_event_away_and_moves_no_reference() -> None:
    """What is seen is reported as without noise, whatever noise came before."""
    noisy, quiet = noisy_pixels(20.0), noisy_pixels(0.0)
    rng = np.random.default_rng(5)
    for n in range(1, 6):
        image = rng.choice(np.float32([0.45, 0.48, 0.5, 0.52, 0.6]), (1, 50, 100))
        seen = quiet.step(image, n * STEP_NS, (n + 1) * STEP_NS)
        events = noisy.step(image, n * STEP_NS, (n + 1) * STEP_NS)
        assert 0 < len(seen) < len(events) < 5000
        assert set(seen.tolist()) < set(events.tolist())
    assert noisy.reference.tolist() == quiet.reference.tolist()


def test_the_seed_determines_the_noise() -> None:
    """Another one gives other events."""
    grey = np.full((1, 50, 100), 0.5, np.float32)
    first, same, other = (
        noisy_pixels(2.0, seed).step(grey, STEP_NS, 2 * STEP_NS).tolist() for seed in (3, 3, 4)
    )
    assert first == same
    assert first != other
