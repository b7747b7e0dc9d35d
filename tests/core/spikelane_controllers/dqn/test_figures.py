"""The figures of a deep Q-network's training: what they say and show."""

from pathlib import Path
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spikelane_controllers.dqn.episodes_figure import draw_episodes
from spikelane_controllers.dqn.state_images_figure import draw_state_images
from spikelane_controllers.dqn.training import Outcome
from spikelane_controllers.learning.training import Termination

#: Label that matplotlib gives to the axes of a colour bar.
SCALE = '<colorbar>'
ACTIONS = [12, 30, 1000]
REASONS = ['lane_lost', 'lane_lost', 'step_limit']
LANES = ('outer', 'inner', 'outer')


def training_of(episodes: int) -> Any:
    """Return a training of some of the episodes above."""
    steps = np.cumsum(ACTIONS).tolist()
    ends = [
        Termination(steps[n], n + 1, LANES[n], 'A', 0.0, 0.0, 10 * ACTIONS[n], REASONS[n])
        for n in range(episodes)
    ]
    outcomes = [Outcome(ACTIONS[n], 2.5 * ACTIONS[n], 0.1, None, 0) for n in range(episodes)]
    return SimpleNamespace(steps=2000, terminations=ends, outcomes=outcomes)


def test_action_steps_and_rewards_are_drawn_by_episode(
    tmp_path: Path, drawn_figures: list[Any]
) -> None:
    """A panel for each, a point for each episode in its lane's colour."""
    (file,) = draw_episodes(training_of(3), LANES[:2], '0.5 s', tmp_path / 'a.svg', 'title')
    said = ' '.join(re.findall(r'<!-- (.*?) -->', file.read_text()))
    assert '2,000 action steps of 0.5 s; lane lost: 2' in said
    assert 'outer lane' in said
    assert 'mean of the last 20 episodes' in said
    for axes, factor in zip(drawn_figures[0].axes, (1.0, 2.5), strict=True):
        line, outer, inner, mean = axes.lines
        assert line.get_ydata().tolist() == [factor * each for each in ACTIONS]
        assert list(outer.get_xdata()) == [1, 3]
        assert list(inner.get_ydata()) == [30 * factor]
        # (12 + 30) / 2, (12 + 30 + 1000) / 3
        assert mean.get_ydata() == pytest.approx([12 * factor, 21 * factor, 1042 / 3 * factor])


def test_a_training_without_an_episode_is_drawn_too(tmp_path: Path) -> None:
    """With empty panels."""
    files = draw_episodes(training_of(0), LANES[:2], '0.5 s', tmp_path / 'a')
    assert [file.suffix for file in files] == ['.svg', '.png']


def test_the_running_mean_is_over_the_last_20_episodes(
    tmp_path: Path, drawn_figures: list[Any]
) -> None:
    """Over 11 to 30 it is 20.5."""
    training = SimpleNamespace(
        steps=465,
        terminations=[
            Termination(0, n, 'outer', 'A', 0.0, 0.0, 10 * n, 'lane_lost') for n in range(1, 31)
        ],
        outcomes=[Outcome(n, float(n), 0.1, None, 0) for n in range(1, 31)],
    )
    draw_episodes(training, LANES[:2], '0.5 s', tmp_path / 'a.svg')
    assert drawn_figures[0].axes[0].lines[-1].get_ydata()[[0, 19, 29]].tolist() == [1, 10.5, 20.5]


def images(figure: Any) -> list[Any]:
    """Return the images of a figure but those of its scales."""
    return [axes.images[0] for axes in figure.axes if axes.images and axes.get_label() != SCALE]


def test_state_images_are_spread_over_the_training(
    tmp_path: Path, drawn_figures: list[Any]
) -> None:
    """Each as counts, all on one scale, and as binary."""
    states = np.zeros((11, 16, 32), np.uint8)
    states[:, 3, 4] = np.arange(11)
    (file,) = draw_state_images(states, 500, tmp_path / 'a.svg')
    shown = images(drawn_figures[0])
    assert [int(image.get_array()[3, 4]) for image in shown] == [2, 1, 4, 1, 6, 1, 8, 1]
    assert [image.get_clim() for image in shown] == [(0, 8), (0, 1)] * 4
    said = re.findall(r'<!-- (.*?) -->', file.read_text())
    assert 'action step 3' in said
    assert 'events in 0.5 s' in said


def test_states_without_events_are_counted_but_not_shown(
    tmp_path: Path, drawn_figures: list[Any]
) -> None:
    """They would be empty panels."""
    states = np.zeros((12, 16, 32), np.uint8)
    states[[1, 2, 3, 7, 8, 11], 5, 5] = 1
    (file,) = draw_state_images(states, 500, tmp_path / 'a.svg')
    assert all(image.get_array().any() for image in images(drawn_figures[0]))
    assert '50.0 % of all states are without events' in file.read_text()
    draw_state_images(np.zeros((3, 16, 32), np.uint8), 500, file)
    assert '100.0 % of all states are without events' in file.read_text()


def test_a_single_state_is_drawn(tmp_path: Path, drawn_figures: list[Any]) -> None:
    """Once."""
    draw_state_images(np.ones((1, 16, 32), np.uint8), 500, tmp_path / 'a.svg')
    assert len(images(drawn_figures[0])) == 2
