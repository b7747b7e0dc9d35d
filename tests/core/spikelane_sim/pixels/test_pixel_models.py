"""What every pixel model promises."""

from hypothesis import given, settings, strategies
import numpy as np
import pytest

from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.pixels import make_pixel_model, PixelModel, PixelParameters

STEP_NS = 50_000_000
MODELS = ('coppelia', 'esim')


def model(name: str, width: int, height: int, seed: int = 0, **esim: float) -> PixelModel:
    """Return a pixel model that is ready for its first image."""
    parameters = PixelParameters.from_mapping({'model': name, 'esim': esim})
    pixels = make_pixel_model(parameters, width, height)
    pixels.reset(np.random.default_rng(seed))
    return pixels


def grey(intensity: float, number: int = 1, height: int = 3, width: int = 2) -> np.ndarray:
    """Return images that are the same everywhere."""
    return np.full((number, height, width), intensity, np.float32)


def noisy_episode(pixels: PixelModel, seed: int, height: int, width: int) -> list[bytes]:
    """Return each step's events, as bytes, in five steps of random images."""
    pixels.reset(np.random.default_rng(seed))
    images = np.random.default_rng(1).random((5, 10, height, width), np.float32)
    images = images[:, : pixels.images_per_step]
    return [
        pixels.step(images[i], i * STEP_NS, (i + 1) * STEP_NS).tobytes()
        for i in range(len(images))
    ]


@pytest.mark.parametrize('name', MODELS)
def test_brighter_is_on_and_darker_is_off(name: str) -> None:
    """The pixel that brightens reports +1, the one that darkens -1."""
    pixels = model(name, 2, 1, substeps=1, leak_rate_hz=0.0)
    pixels.step(np.float32([[[0.5, 0.5]]]), 0, STEP_NS)
    events = pixels.step(np.float32([[[0.65, 0.38]]]), STEP_NS, 2 * STEP_NS)
    assert sorted(events[['x', 'polarity']].tolist()) == [(0, 1), (1, -1)]


@pytest.mark.parametrize('name', MODELS)
def test_the_first_image_gives_no_events_after_every_reset(name: str) -> None:
    """It only sets the references, even if it has nothing in common with what was seen before."""
    pixels = model(name, 2, 3, leak_rate_hz=1000.0, shot_rate_hz=1000.0)
    assert len(pixels.step(grey(0.2), 0, STEP_NS)) == 0
    brighter = grey(0.9, pixels.images_per_step)
    assert len(pixels.step(brighter, STEP_NS, 2 * STEP_NS)) >= 6
    pixels.reset(np.random.default_rng(0))
    assert len(pixels.step(grey(0.2), 0, STEP_NS)) == 0


@pytest.mark.parametrize('name', MODELS)
def test_the_same_seed_gives_the_same_events_whatever_came_before(name: str) -> None:
    """An episode repeats bit for bit on a used model and on a new one."""
    noise = {'shot_rate_hz': 50.0, 'latency_s': 0.07, 'refractory_s': 0.002}
    used = model(name, 9, 11, **noise)
    first = noisy_episode(used, 3, 11, 9)
    noisy_episode(used, 4, 11, 9)
    assert noisy_episode(used, 3, 11, 9) == first
    assert noisy_episode(model(name, 9, 11, **noise), 3, 11, 9) == first
    assert len(first[-1]) > 0


def test_only_the_noisy_model_depends_on_the_seed() -> None:
    """The paper's sensor has no randomness, the real one's pixels differ by the seed."""
    coppelia, esim = model('coppelia', 9, 11), model('esim', 9, 11)
    assert noisy_episode(coppelia, 3, 11, 9) == noisy_episode(coppelia, 4, 11, 9)
    assert noisy_episode(esim, 3, 11, 9) != noisy_episode(esim, 4, 11, 9)


def test_the_paper_s_sensor_takes_one_image_per_step_and_the_real_one_its_substeps() -> None:
    """One at the step's end, or as many as the parameter says, ten if it does not."""
    assert model('coppelia', 2, 3).images_per_step == 1
    assert model('esim', 2, 3).images_per_step == 10
    assert model('esim', 2, 3, substeps=4).images_per_step == 4


@settings(max_examples=60, deadline=None)
@given(
    name=strategies.sampled_from(MODELS),
    seed=strategies.integers(0, 2**32),
    width=strategies.integers(1, 40),
    height=strategies.integers(1, 12),
    substeps=strategies.integers(1, 7),
    step_us=strategies.sampled_from([1, 2, 7, 1000, 50_000]),
    latency_s=strategies.sampled_from([0.0, 1e-6, 0.0123, 0.2]),
    refractory_s=strategies.sampled_from([0.0, 1e-6, 0.001]),
)
def test_events_come_ordered_by_time_row_and_column_inside_their_step(
    check_events, name, seed, width, height, substeps, step_us, latency_s, refractory_s
) -> None:
    """On random images with noise, whatever the size, step, latency and refractory period."""
    pixels = model(
        name,
        width,
        height,
        seed,
        substeps=substeps,
        latency_s=latency_s,
        refractory_s=refractory_s,
        leak_rate_hz=100.0,
        shot_rate_hz=100.0,
    )
    rng = np.random.default_rng(seed)
    for step in range(4):
        images = rng.random((pixels.images_per_step, height, width), np.float32)
        start_ns, end_ns = (step * step_us * 1000, (step + 1) * step_us * 1000)
        events = pixels.step(images, start_ns, end_ns)
        check_events(events, width, height)
        assert all(start_ns < t <= end_ns and t % 1000 == 0 for t in events['t'].tolist())
        places = events[['t', 'y', 'x']].tolist()
        assert places == sorted(places)


@pytest.mark.parametrize('name', MODELS)
@pytest.mark.parametrize(
    'images',
    [
        np.zeros((1, 2, 3), np.float32),
        np.zeros((3, 2), np.float32),
        np.zeros((1, 3, 2)),
        np.zeros((1, 3, 2), np.uint8),
        np.zeros((3, 3, 2), np.float32),
        np.zeros((0, 3, 2), np.float32),
        np.zeros((1, 2, 3), np.float32).transpose(0, 2, 1),
    ],
)
def test_images_of_another_shape_or_type_are_refused(name: str, images: np.ndarray) -> None:
    """The message says what was expected and what came."""
    pixels = model(name, 2, 3)
    with pytest.raises(SpikelaneError, match=r'images: expected contiguous float32 of shape \(1'):
        pixels.step(images, 0, STEP_NS)


@pytest.mark.parametrize('name', MODELS)
@pytest.mark.parametrize(('start_ns', 'end_ns'), [(5000, 5000), (5000, 0), (0, 1500), (1, 5000)])
def test_steps_that_do_not_go_forward_in_whole_microseconds_are_refused(
    name: str, start_ns: int, end_ns: int
) -> None:
    """An event could not be given a time in them."""
    with pytest.raises(SpikelaneError, match='step: expected increasing times'):
        model(name, 2, 3).step(grey(0.5), start_ns, end_ns)


@pytest.mark.parametrize('name', MODELS)
def test_a_step_before_any_reset_is_refused(name: str) -> None:
    """Without a generator there is nothing to draw thresholds and noise from."""
    pixels = make_pixel_model(PixelParameters(model=name), 2, 3)
    with pytest.raises(SpikelaneError, match='expected a reset before the first step'):
        pixels.step(grey(0.5), 0, STEP_NS)


@pytest.mark.parametrize(('width', 'height'), [(0, 3), (2, -1), (65_536, 1)])
def test_sensors_that_events_cannot_address_are_refused(width: int, height: int) -> None:
    """Coordinates are sixteen bits wide."""
    with pytest.raises(ParameterError, match='sensor size: expected 1 to 65535'):
        make_pixel_model(PixelParameters(), width, height)


def test_parameters_have_dotted_names_and_the_paper_s_defaults() -> None:
    """The paper's sensor is the default; every parameter of both models can be set by name."""
    values = PixelParameters().to_dict()
    assert values['model'] == 'coppelia'
    assert values['coppelia.threshold'] == 0.1
    assert values['coppelia.dark_intensity'] == 0.001
    assert values['esim.threshold_on'] == values['esim.threshold_off'] == 0.2
    with pytest.raises(ParameterError, match='model: expected one of coppelia, esim'):
        PixelParameters(model='dvs')
    with pytest.raises(ParameterError, match=r'esim.latency_s: expected a number from 0 to 0.2 s'):
        PixelParameters.from_mapping({'esim.latency_s': 0.3})
