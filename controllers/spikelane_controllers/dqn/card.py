"""The card of the deep Q-network."""

from pathlib import Path

from spikelane_controllers.card import Aim, ControllerCard, PaperCard, PaperValue, TrainingCard

_LAYERS = ('weights_1', 'biases_1', 'weights_2', 'biases_2', 'weights_3', 'biases_3')

TRAINING = TrainingCard(
    training='spikelane_controllers.dqn.training:DqnTraining',
    results='spikelane_controllers.dqn.results:DqnResults',
    # Section 3.4: a reset where the robot leaves its lane, or after 1,000 actions.
    defaults={
        'simulator.episode.max_distance_m': 0.5,
        'simulator.episode.max_laps': 0,
        'simulator.episode.max_steps': 10_000,
    },
    device='q_learning.device',
)

CARD = ControllerCard(
    controller='spikelane_controllers.dqn.controller:Dqn',
    fleet='spikelane_controllers.dqn.fleet:DqnFleet',
    title='DQN',
    training=TRAINING,
    weights=Path(__file__).parent / 'weights',
    weight_arrays=tuple(
        f'controller.{network}.{layer}' for network in ('network', 'target') for layer in _LAYERS
    ),
    figures='spikelane_controllers.dqn.figures:figures',
    paper=PaperCard(
        order=0,
        laps=('1', '2'),
        learnt=('1', '2', '3'),
        values=(
            PaperValue('1', 'solved_episode', 580, 'about 580', 'section 5.1'),
            PaperValue(
                '3', 'solved_episode', None, 'none of 1,186', 'caption, DQN training, scenario 3'
            ),
            PaperValue('1', 'mean_abs_distance_m', 0.041, '0.041 m', 'section 6'),
            PaperValue('1', 'lap_steps', 5_000, 'about 5,000', 'section 5.1'),
            PaperValue('2', 'mean_abs_distance_m', None, 'above 0.041 m', 'section 6'),
        ),
    ),
    aims=(
        Aim('1', 'solved_step', 60_000, setting=''),
        Aim('2', 'solved_step', 60_000, setting=''),
        Aim('3', 'solved_step', 100_000, setting=''),
        Aim('1', 'mean_abs_distance_m', 0.02, setting=''),
        Aim('2', 'mean_abs_distance_m', 0.03, setting=''),
        Aim('3', 'mean_abs_distance_m', 0.025, setting=''),
    ),
)
