"""What a training of the deep Q-network came to: metrics, and columns of its episodes."""

from __future__ import annotations

from typing import Any

from spikelane_controllers.dqn_training import DqnTraining, Outcome
from spikelane_controllers.training import Termination
from spikelane_sim.contract import TERMINATED_STEP_LIMIT

_IN_A_ROW = 3


def dqn_metrics(training: DqnTraining) -> dict[str, Any]:
    """Measure a training.

    Returns:
        solved_at: Action step from which three episodes in a row went to the step limit, all
            lanes among them; None where there were none.
        solved_by: Action step at which the third of them ended, or None.
        full_episodes: Episodes that went to the step limit.
        reward_per_action: Mean over the last 10 episodes, None where there were none.
        updates: Times the network was changed.
        states: States kept.
    """
    solved = first_solved(training.terminations)
    third = None if solved is None else training.terminations[solved + _IN_A_ROW - 1]
    last = training.outcomes[-10:]
    actions = sum(each.actions for each in last)
    return {
        'solved_at': None if solved is None else _begin(training, solved),
        'solved_by': None if third is None else third.step,
        'full_episodes': sum(map(_is_full, training.terminations)),
        'reward_per_action': sum(each.reward for each in last) / actions if actions else None,
        'updates': training.controller.learner.updates,
        'states': training.steps,
    }


def episode_columns(outcomes: list[Outcome]) -> list[dict[str, Any]]:
    """Return what is known of each episode beside how it ended, by column."""
    return [
        {
            'actions': each.actions,
            'reward': each.reward,
            'exploration_rate': each.exploration_rate,
            'loss': each.loss,
        }
        for each in outcomes
    ]


def _is_full(episode: Termination) -> bool:
    return episode.reason == TERMINATED_STEP_LIMIT


def first_solved(episodes: list[Termination]) -> int | None:
    """Return the index of the first episode of the first three in a row that were full.

    All lanes that episodes were driven on are among the three.
    """
    lanes = {each.lane for each in episodes}
    for index in range(len(episodes) - _IN_A_ROW + 1):
        run = episodes[index : index + _IN_A_ROW]
        if all(map(_is_full, run)) and {each.lane for each in run} == lanes:
            return index
    return None


def _begin(training: DqnTraining, index: int) -> int:
    return training.terminations[index].step - training.outcomes[index].actions
