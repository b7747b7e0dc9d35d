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
from spikelane_sim import figure_style as style

ACTIONS = [12, 30, 1000]
REASONS = ['lane_lost', 'lane_lost', 'step_limit']
LANES = ['outer', 'inner', 'outer']


def training_of(episodes: int) -> Any:
    """Return a training of some of the episodes above."""
    steps = np.cumsum(ACTIONS).tolist()
    ends = [
        Termination(steps[n], n + 1, LANES[n], 'A', 0.0, 0.0, 10 * ACTIONS[n], REASONS[n])
        for n in range(episodes)
    ]
    outcomes = [Outcome(ACTIONS[n], 2.5 * ACTIONS[n], 0.1, None, 0) for n in range(episodes)]
    return SimpleNamespace(steps=2000, terminations=ends, outcomes=outcomes)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return a list that the figures drawn are put in."""
    figures: list[Any] = []
    save = style.save

    def keep(figure: Any, path: Path) -> tuple[Path, ...]:
        figures.append(figure)
        return save(figure, path)

    monkeypatch.setattr(style, 'save', keep)
    return figures


def test_action_steps_and_rewards_are_drawn_by_episode(tmp_path: Path, drawn: list[Any]) -> None:
    """A panel for each, a point for each episode in its lane's colour."""
    (file,) = draw_episodes(training_of(3), ('outer', 'inner'), tmp_path / 'a.svg', 'title')
    said = ' '.join(re.findall(r'<!-- (.*?) -->', file.read_text()))
    assert '2,000 action steps, lane lost: 2' in said
    assert 'outer lane' in said
    for axes, factor in zip(drawn[0].axes, (1.0, 2.5), strict=True):
        line, outer, inner = axes.lines
        assert line.get_ydata().tolist() == [factor * each for each in ACTIONS]
        assert list(outer.get_xdata()) == [1, 3]
        assert list(inner.get_ydata()) == [30 * factor]


def test_a_training_without_an_episode_is_drawn_too(tmp_path: Path) -> None:
    """With empty panels."""
    files = draw_episodes(training_of(0), ('outer', 'inner'), tmp_path / 'a')
    assert [file.suffix for file in files] == ['.svg', '.png']


def test_state_images_are_spread_over_the_training(tmp_path: Path, drawn: list[Any]) -> None:
    """Each as counts and as binary."""
    states = np.zeros((11, 16, 32), np.uint8)
    states[:, 3, 4] = np.arange(11)
    draw_state_images(states, tmp_path / 'a.svg')
    images = [axes.images[0].get_array() for axes in drawn[0].axes]
    assert [int(image[3, 4]) for image in images] == [2, 1, 4, 1, 6, 1, 8, 1]


def test_a_single_state_is_drawn(tmp_path: Path, drawn: list[Any]) -> None:
    """Once."""
    draw_state_images(np.ones((1, 16, 32), np.uint8), tmp_path / 'a.svg')
    assert len(drawn[0].axes) == 2
