"""The card of R-STDP."""

from pathlib import Path

from spikelane_controllers.card import Aim, ControllerCard, PaperCard, PaperValue, TrainingCard

_CAPTION = 'caption, R-STDP terminations, scenario'

TRAINING = TrainingCard(
    training='spikelane_controllers.rstdp.training:PlasticTraining',
    results='spikelane_controllers.rstdp.results:PlasticResults',
    # Section 4.4: a reset where the robot leaves its lane, or has completed a lap.
    defaults={
        'simulator.episode.max_distance_m': 0.2,
        'simulator.episode.max_laps': 1,
    },
    is_usual=True,
)

CARD = ControllerCard(
    controller='spikelane_controllers.rstdp.controller:RStdp',
    fleet='spikelane_controllers.rstdp.fleet:RStdpFleet',
    title='R-STDP',
    training=TRAINING,
    weights=Path(__file__).parent / 'weights',
    weight_arrays=('controller.network.weights_pa',),
    figures='spikelane_controllers.rstdp.figures:figures',
    paper=PaperCard(
        order=3,
        laps=('1', '2', '3'),
        learnt=('1', '2', '3'),
        values=(
            PaperValue('1', 'last_lane_loss_step', 10_000, 'about 10,000', f'{_CAPTION} 1'),
            PaperValue('2', 'last_lane_loss_step', 14_000, 'about 14,000', f'{_CAPTION} 2'),
            PaperValue(
                '3',
                'last_lane_loss_step',
                75_000,
                'about 75,000',
                f'{_CAPTION} 3 (section 6: about 40,000)',
            ),
            PaperValue(
                '1', 'mean_abs_distance_m', None, "almost a tenth of the others'", 'section 6'
            ),
        ),
    ),
    aims=(
        Aim('1', 'last_lane_loss_step', 9_000, setting='', is_of_median=True),
        Aim('2', 'last_lane_loss_step', 18_000, setting='', is_of_median=True),
        Aim('3', 'last_lane_loss_step', 70_000, setting='', is_of_median=True),
        Aim('1', 'last_lane_loss_step', 2_500, setting='best', is_of_median=True),
        Aim('2', 'last_lane_loss_step', 2_500, setting='best', is_of_median=True),
        Aim('3', 'last_lane_loss_step', 12_000, setting='best', is_of_median=True),
        Aim('1', 'mean_abs_distance_m', 0.007, setting=''),
        Aim('2', 'mean_abs_distance_m', 0.007, setting=''),
        Aim('3', 'mean_abs_distance_m', 0.01, setting=''),
    ),
)
