"""What the paper reports in numbers, and where in it: the one place of these values.

Bing et al. (2020), Neural Networks 121. Its figures give most errors as curves only; what is here
is written in its text, tables and captions.
"""

from __future__ import annotations

from typing import NamedTuple

PAPER_SCENARIOS = ('1', '2', '3')


class PaperValue(NamedTuple):
    """One result of the paper.

    Attributes:
        controller: Name in the controllers' registry.
        scenario: '1' to '3' of the paper.
        measure: Name of what was measured, one of `tables.MEASURES`.
        value: In that measure's unit; None where the paper says it in words alone.
        words: As the report shows it.
        place: In the paper.
    """

    controller: str
    scenario: str
    measure: str
    value: float | None
    words: str
    place: str


VALUES = (
    PaperValue(
        'rstdp',
        '1',
        'last_lane_loss_step',
        10_000,
        'about 10,000',
        'caption, R-STDP terminations, scenario 1',
    ),
    PaperValue(
        'rstdp',
        '2',
        'last_lane_loss_step',
        14_000,
        'about 14,000',
        'caption, R-STDP terminations, scenario 2',
    ),
    PaperValue(
        'rstdp',
        '3',
        'last_lane_loss_step',
        75_000,
        'about 75,000',
        'caption, R-STDP terminations, scenario 3 (section 6: about 40,000)',
    ),
    PaperValue('dqn', '1', 'solved_episode', 580, 'about 580', 'section 5.1'),
    PaperValue(
        'dqn', '3', 'solved_episode', None, 'none of 1,186', 'caption, DQN training, scenario 3'
    ),
    PaperValue('dqn_snn', '1', 'accuracy', 0.9305, '93.05 %', 'section 5.2'),
    PaperValue('dqn_snn', '2', 'accuracy', 0.9171, '91.71 %', 'section 5.2'),
    PaperValue('dqn', '1', 'mean_abs_distance_m', 0.041, '0.041 m', 'section 6'),
    PaperValue('dqn', '1', 'lap_steps', 5_000, 'about 5,000', 'section 5.1'),
    PaperValue('dqn', '2', 'mean_abs_distance_m', None, 'above 0.041 m', 'section 6'),
    PaperValue('dqn_snn', '1', 'mean_abs_distance_m', None, 'below 0.041 m', 'section 6'),
    PaperValue('braitenberg', '1', 'mean_abs_distance_m', None, "like DQN's", 'section 6'),
    PaperValue(
        'rstdp', '1', 'mean_abs_distance_m', None, "almost a tenth of the others'", 'section 6'
    ),
)


def paper_value(controller: str, scenario: str, measure: str) -> PaperValue | None:
    """Return what the paper says of a measure, None where it says nothing."""
    wanted = (controller, scenario, measure)
    return next((each for each in VALUES if each[:3] == wanted), None)
