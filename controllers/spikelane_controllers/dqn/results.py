"""What a training of the deep Q-network has to show.

A full episode went to the step limit; the training has solved its task with the first three full
episodes in a row, all lanes among them. Steps are actions.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any, ClassVar

from spikelane_controllers.dqn.training import Outcome
from spikelane_controllers.dqn.visited_states import read_states
from spikelane_controllers.learning.results import (
    Figure,
    first_stable,
    IN_A_ROW,
    Measure,
    NothingToDrawError,
    Time,
    TrainingResults,
)
from spikelane_controllers.learning.training import Termination
from spikelane_controllers.saved_state import mapping, number, records
from spikelane_sim.contract import TERMINATED_STEP_LIMIT
from spikelane_sim.period import PERIOD_MS
from spikelane_sim.simulator_parameters import current_config, period_ms_of


class DqnResults(TrainingResults):
    """What a training of the deep Q-network has to show.

    Attributes:
        outcomes: What each episode brought, as `terminations`.
        updates: How often the network was changed.
    """

    step_words: ClassVar[str] = 'one action (0.5 s)'

    def _read(self, facts: Mapping[str, Any]) -> None:
        self.outcomes = records(facts, 'outcomes', Outcome)
        self.updates = number(mapping(facts, 'controller'), 'updates', int)

    @property
    def full_episodes(self) -> int:
        """Episodes that went to the step limit."""
        return sum(map(_is_full, self.terminations))

    @property
    def solved_episode(self) -> int | None:
        """Number of the first of the three episodes that solved the task, from 1 on."""
        index = first_stable(self.terminations)
        return None if index is None else index + 1

    @property
    def solved_step(self) -> int | None:
        """Action step by which these three episodes had ended."""
        index = first_stable(self.terminations)
        return None if index is None else self.terminations[index + IN_A_ROW - 1].step

    def metrics(self) -> dict[str, Any]:
        """Measure the training.

        Returns:
            As `TrainingResults.metrics`, and:
            solved_at: Action step from which three episodes in a row went to the step limit, all
                lanes among them; None where there were none.
            solved_by: Action step at which the third of them ended, or None.
            full_episodes: Episodes that went to the step limit.
            reward_per_action: Mean over the last 10 episodes, None where there were none.
            updates: Times the network was changed.
            states: States kept.
        """
        solved = first_stable(self.terminations)
        last = self.outcomes[-10:]
        actions = sum(each.actions for each in last)
        begin = None
        if solved is not None:
            begin = self.terminations[solved].step - self.outcomes[solved].actions
        return {
            **super().metrics(),
            'solved_at': begin,
            'solved_by': self.solved_step,
            'full_episodes': self.full_episodes,
            'reward_per_action': sum(each.reward for each in last) / actions if actions else None,
            'updates': self.updates,
            'states': self.steps,
        }

    def episode_columns(self) -> list[dict[str, Any]]:
        """Return what is known of each episode in addition to its termination, by column."""
        return [
            {
                'actions': each.actions,
                'reward': each.reward,
                'exploration_rate': each.exploration_rate,
                'loss': each.loss,
            }
            for each in self.outcomes
        ]

    def summary(self) -> dict[str, str]:
        """Return what a person wants to know first of how well it drives, by name."""
        metrics = self.metrics()
        solved = 'no three in a row on both lanes'
        if metrics['solved_at'] is not None:
            solved = f'three in a row on both lanes from step {metrics["solved_at"]}'
        return {'full episodes': f'{metrics["full_episodes"]}, {solved}'}

    def measures(self) -> tuple[Measure, ...]:
        """Return what reports compare."""
        episode, step = self.solved_episode, self.solved_step
        return (
            Measure(
                'solved_episode',
                'first of three full episodes in a row',
                'count',
                len(self.terminations) if episode is None else episode,
                episode is not None,
            ),
            Measure(
                'solved_step',
                'action step at the end of the first three full episodes in a row',
                'count',
                self.steps if step is None else step,
                step is not None,
            ),
            Measure('full_episodes', 'full episodes', 'count', self.full_episodes),
        )

    def first_lap(self) -> Time:
        """Return when the first lap was completed, or the training's end.

        Episodes go on after a lap. The robot drives at one speed, so that a lap is what an
        episode of the lane's length at that speed has.
        """
        course = self.course()
        radius_m = self.run.config['simulator']['robot.wheel_radius_m']
        wheel_rad_s = self.run.config[self.run.controller]['task.drive_rad_s'] * self._speed
        per_step_m = wheel_rad_s * radius_m * self._period_s
        driven = 0
        for episode in self.terminations:
            needed = math.ceil(course.lane(episode.lane).length_m / per_step_m)
            if episode.episode_steps >= needed:
                return Time(driven + needed, True)
            driven += episode.episode_steps
        return Time(driven, False)

    @property
    def _speed(self) -> float:
        return float(current_config(self.run.config)['simulator']['speed'])

    @property
    def _period_s(self) -> float:
        return period_ms_of(self.run.config) / 1000

    @property
    def _driven_steps(self) -> int:
        return int(sum(each.episode_steps for each in self.terminations))

    def figures(self) -> tuple[Figure, ...]:
        """Return what can be drawn."""
        return (
            Figure(self._heading, 'episodes', 'Episodes and rewards', self._draw_episodes),
            Figure(self._heading, 'state_images', 'States met', self._draw_states),
        )

    def _draw_episodes(self, path: Path, title: str) -> tuple[Path, ...]:
        from spikelane_controllers.dqn.episodes_figure import draw_episodes

        config = self.run.config[self.run.controller]
        steps, step_ms = config['task.steps_per_action'], config.get('task.step_ms', PERIOD_MS)
        action_step = f'{steps * step_ms / 1000:g} s ({steps} steps of {step_ms:g} ms)'
        return draw_episodes(self, tuple(self.course().lanes), action_step, path, title)

    def _draw_states(self, path: Path, title: str) -> tuple[Path, ...]:
        from spikelane_controllers.dqn.state_images_figure import draw_state_images

        states = read_states(self.run.folder)
        if not len(states):
            raise NothingToDrawError(f'{self.run.folder}: expected states met, got none')
        config = self.run.config[self.run.controller]
        frames, frame_ms = config['image.frames'], config.get('image.frame_ms', PERIOD_MS)
        return draw_state_images(states, frames * frame_ms, path, title)


def _is_full(episode: Termination) -> bool:
    return episode.reason == TERMINATED_STEP_LIMIT
