"""The figures of a training: what they say and where they put it."""

from pathlib import Path
import re
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
import pytest

from spikelane_controllers.learning.learning_controller import LearningController
from spikelane_controllers.learning.terminations_figure import draw_terminations
from spikelane_controllers.learning.training import (
    Termination,
    TrainingParameters,
)
from spikelane_controllers.rstdp.training import PlasticTraining
from spikelane_controllers.spiking.weights_by_hand import weights_correlation
from spikelane_controllers.spiking.weights_figure import draw_weights
from spikelane_sim import figure_style as style
from spikelane_sim.course import load_course
from spikelane_sim.encoding import EncodingParameters
from spikelane_sim.errors import SpikelaneError

#: The Braitenberg controller's, typed off the paper's figure: half an image, its rows.
HALF = np.array(
    [[250, 250, 250, 500], [250, 250, 500, 1000], [250, 500, 1000, 1500], [500, 1000, 1500, 2000]]
)
LEFT = np.hstack([HALF, 0 * HALF]).ravel().astype(np.float64)
RIGHT = np.hstack([0 * HALF, HALF[:, ::-1]]).ravel().astype(np.float64)

TERMINATIONS = [
    Termination(778, 1, 'outer', 'B', 5.99, 0.202, 778, 'lane_lost'),
    Termination(1034, 2, 'inner', 'C', 2.14, -0.202, 256, 'lane_lost'),
    Termination(5700, 3, 'outer', 'A', 0.52, 0.01, 4666, 'laps_complete'),
    Termination(9900, 4, 'inner', 'C', 0.51, -0.01, 4200, 'laps_complete'),
    Termination(12345, 5, 'outer', 'A', 0.25, -0.203, 2445, 'lane_lost'),
]


def trained(
    weights_pa: NDArray[np.float64], terminations: list[Termination], steps: int = 20_000
) -> PlasticTraining:
    """Return a training that ended with these weights, saved every 10,000 steps."""
    controller = cast(LearningController, SimpleNamespace(weights_pa=weights_pa))
    parameters = TrainingParameters(steps=steps, save_every=10_000)
    training = PlasticTraining('rstdp', controller, parameters, {}, Path('unused.safetensors'))
    training.steps = steps
    training.terminations = terminations
    saved = [200.0 + 0 * weights_pa, (200.0 + weights_pa) / 2, weights_pa]
    training.weight_history = [each.astype(np.float32) for each in saved[: 1 + steps // 10_000]]
    return training


def texts(svg: Path) -> list[str]:
    """Return the texts of a figure, which SVG keeps as comments next to their outlines."""
    return re.findall(r'<!-- (.*?) -->', svg.read_text())


def test_the_weights_are_written_in_their_cells(tmp_path: Path, drawn_figures: list[Any]) -> None:
    """Left neuron first, row 0 at the top, on one scale that begins at zero."""
    weights_pa = np.arange(64, dtype=np.float64).reshape(2, 32) * 10
    files = draw_weights(
        trained(weights_pa, []), EncodingParameters(), tmp_path / 'weights', 'R-STDP'
    )
    assert [file.name for file in files] == ['weights.svg', 'weights.png']
    said = texts(files[0])
    for text in ('R-STDP', 'left motor neuron', 'right motor neuron', 'weight [pA]'):
        assert text in said
    left, right = drawn_figures[0].axes[:2]
    for axes, first in ((left, 0), (right, 320)):
        image = axes.images[0]
        assert (image.norm.vmin, image.norm.vmax) == (0.0, 630.0)
        places = {tuple(text.get_position()): text.get_text() for text in axes.texts}
        assert places[0, 0] == str(first)
        assert places[7, 0] == str(first + 70)
        assert places[0, 3] == str(first + 240)
        assert axes.yaxis_inverted()


def test_the_weights_are_drawn_over_the_steps(tmp_path: Path, drawn_figures: list[Any]) -> None:
    """All 64 in the colour of their half, from step 0 to the last, and the lane losses."""
    training = trained(np.stack([LEFT, RIGHT]), TERMINATIONS)
    draw_weights(training, EncodingParameters(), tmp_path / 'weights.svg')
    left, right = [axes for axes in drawn_figures[0].axes if axes.get_xlabel().startswith('step')]
    for axes in (left, right):
        assert [len(line.get_xdata()) for line in axes.lines] == [3] * 32 + [2] * 3
        assert [line.get_xdata()[0] for line in axes.lines[32:]] == [778, 1034, 12345]
        colours = [line.get_color() for line in axes.lines[:32]]
        assert colours == ([style.LEFT] * 4 + [style.RIGHT] * 4) * 4
    assert list(left.lines[27].get_xdata()) == [0, 10_000, 20_000]
    assert list(left.lines[27].get_ydata()) == [200, 1100, 2000]
    assert list(right.lines[27].get_ydata()) == [200, 100, 0]


def test_weights_between_two_savings_are_drawn_too(
    tmp_path: Path, drawn_figures: list[Any]
) -> None:
    """The lines end where the images are."""
    training = trained(np.stack([LEFT, RIGHT]), [], steps=12_000)
    draw_weights(training, EncodingParameters(), tmp_path / 'weights.svg')
    axes = drawn_figures[0].axes[-1]
    assert list(axes.lines[28].get_xdata()) == [0, 10_000, 12_000]
    assert list(axes.lines[28].get_ydata()) == [200, 1100, 2000]


def test_inputs_that_saw_no_events_are_hatched(tmp_path: Path, drawn_figures: list[Any]) -> None:
    """They are those whose weights to both neurons never moved."""
    weights_pa = np.stack([LEFT, RIGHT])
    weights_pa[:, 31] = 200.0
    weights_pa[0, 30] = 200.0
    [file] = draw_weights(trained(weights_pa, []), EncodingParameters(), tmp_path / 'weights.svg')
    assert 'saw no events' in texts(file)
    for axes in drawn_figures[0].axes[:2]:
        assert [patch.get_xy() for patch in axes.patches] == [(6.5, 2.5)]


def test_the_figure_of_weights_says_what_it_is_given_to_say(tmp_path: Path) -> None:
    """Behind the number of steps."""
    training = trained(np.stack([LEFT, RIGHT]), [])
    encoding = EncodingParameters()
    [file] = draw_weights(training, encoding, tmp_path / 'weights.svg', words='all well')
    assert 'weights after 20,000 steps; all well' in texts(file)
    finer = trained(np.random.default_rng(0).uniform(0, 3000, (2, 128)), [])
    [file] = draw_weights(finer, EncodingParameters(cell=8), tmp_path / 'finer.svg')
    assert 'weights after 20,000 steps' in texts(file)


def test_weights_of_another_shape_are_refused(tmp_path: Path) -> None:
    """The message has both."""
    training = trained(np.ones((2, 128)), [])
    with pytest.raises(SpikelaneError, match='2 neurons and 4 x 8 inputs, got 2 x 128'):
        draw_weights(training, EncodingParameters(), tmp_path / 'weights.svg')
    with pytest.raises(SpikelaneError, match='2 x 32, as those set by hand, got 2 x 128'):
        weights_correlation(np.ones((2, 128)))


def test_the_correlation_is_pearsons() -> None:
    """The two halves do not overlap, so that cov = -mean^2.

    The weights of a neuron sum to 11,500 and their squares to 12,875,000, so with 32 inputs
    mean^2 is 129,150.39 and the variance 273,193.36; their ratio is 0.4727435.
    """
    alike = weights_correlation(3.0 * np.stack([LEFT, RIGHT]) + 7.0)
    assert alike == pytest.approx({'left': 1.0, 'right': 1.0, 'overall': 1.0})
    crossed = weights_correlation(np.stack([RIGHT, LEFT]))
    assert crossed == pytest.approx(dict.fromkeys(('left', 'right', 'overall'), -0.4727435))
    mixed = weights_correlation(np.stack([LEFT, LEFT]))
    assert mixed == pytest.approx(
        {'left': 1.0, 'right': -0.4727435, 'overall': (1.0 - 0.4727435) / 2}, abs=1e-6
    )


def test_inputs_that_saw_no_events_can_be_left_out_of_the_correlation() -> None:
    """They still have the weights they began with."""
    initial_pa = np.random.default_rng(0).uniform(200, 201, (2, 32))
    weights_pa = np.stack([LEFT, RIGHT])
    weights_pa[:, [3, 30, 31]] = initial_pa[:, [3, 30, 31]]
    found = weights_correlation(weights_pa, initial_pa)
    assert found['inputs_seen'] == 29
    assert found['left_seen'] == found['right_seen'] == found['overall_seen'] == pytest.approx(1)
    assert all(found[name] < 0.99 for name in ('right', 'overall'))  # type: ignore[operator]


def test_weights_that_are_all_the_same_have_no_correlation() -> None:
    """It is None and not NaN, since JSON has no NaN."""
    same = np.full((2, 32), 200.0)
    found = weights_correlation(same, same)
    assert found.pop('inputs_seen') == 0
    assert list(found.values()) == [None] * 6


def test_every_episode_ends_where_it_did(tmp_path: Path, drawn_figures: list[Any]) -> None:
    """A panel per lane; laps end one lane's length farther on, as does what comes after them."""
    files = draw_terminations(
        trained(np.ones((2, 32)), TERMINATIONS), load_course('scenario_1'), tmp_path / 'ends'
    )
    assert [file.name for file in files] == ['ends.svg', 'ends.png']
    outer, inner = drawn_figures[0].axes
    assert ends(outer) == [
        (778, pytest.approx(5.99), 'X', style.RIGHT),
        (5700, pytest.approx(0.52 + 31.992, abs=1e-3), 'o', style.INK),
        (12345, pytest.approx(0.25 + 31.992, abs=1e-3), 'X', style.LEFT),
    ]
    assert [(step, mark) for step, _, mark, _ in ends(inner)] == [(1034, 'X'), (9900, 'o')]
    begun = [line.get_xdata()[0] for line in outer.lines if len(line.get_xdata()) == 2]
    assert begun == [0, 1034, 9900]
    for axes in (outer, inner):
        assert axes.get_xlim() == (0, 20_000)


def ends(axes: Any) -> list[tuple[int, float, str, str]]:
    """Return step, position, marker and colour of the ends in a panel."""
    lines = [line for line in axes.lines if len(line.get_xdata()) == 1]
    return [
        (line.get_xdata()[0], line.get_ydata()[0], line.get_marker(), line.get_color())
        for line in lines
    ]


def test_the_sections_are_marked_in_each_lanes_order(
    tmp_path: Path, drawn_figures: list[Any]
) -> None:
    """Each with its letter in the middle of its band, which is as long as the section."""
    training = trained(np.ones((2, 32)), TERMINATIONS)
    [file] = draw_terminations(training, load_course('scenario_1'), tmp_path / 'ends.svg')
    said = texts(file)
    assert [text for text in said if text in tuple('ABCDEF')] == list('ABCDEF') + list('CBAFED')
    for text in (
        'outer lane',
        'inner lane',
        'lane lost to the right',
        'lane lost to the left',
        'lap completed',
        'lane lost: 3, last at step 12,345; laps completed: 2; not settled',
    ):
        assert text in said
    assert 'ended otherwise' not in said
    places = {text.get_text(): text.get_position()[1] for text in drawn_figures[0].axes[0].texts}
    assert places['A'] == pytest.approx(2.5)
    assert places['B'] == pytest.approx(5 + 3.534 / 2, abs=1e-3)


def test_a_training_without_any_termination_can_be_drawn(tmp_path: Path) -> None:
    """Nothing to explain then."""
    training = trained(np.ones((2, 32)), [])
    [file] = draw_terminations(training, load_course('scenario_1'), tmp_path / 'ends.svg')
    assert 'lane lost: 0; laps completed: 0' in texts(file)


def test_terminations_on_another_course_are_refused(tmp_path: Path) -> None:
    """The message has the lanes there are."""
    elsewhere = [TERMINATIONS[0]._replace(lane='middle')]
    with pytest.raises(SpikelaneError, match="expected outer or inner, got 'middle'"):
        draw_terminations(
            trained(np.ones((2, 32)), elsewhere), load_course('scenario_1'), tmp_path / 'ends.svg'
        )


@pytest.mark.parametrize('suffix', ['.svg', '.png'])
def test_the_same_training_gives_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    """No dates, no random names, nothing of the user's own settings."""
    import matplotlib

    def draw(name: str) -> list[bytes]:
        training = trained(np.stack([LEFT, RIGHT]), TERMINATIONS)
        course = load_course('scenario_1')
        files = [
            *draw_weights(training, EncodingParameters(), tmp_path / f'{name}w{suffix}'),
            *draw_terminations(training, course, tmp_path / f'{name}t{suffix}'),
        ]
        return [file.read_bytes() for file in files]

    first = draw('first')
    with matplotlib.rc_context({'font.size': 30.0, 'axes.facecolor': 'black', 'axes.grid': True}):
        assert draw('second') == first
