"""The card of the spiking network that takes over a deep Q-network's policy."""

from pathlib import Path

from spikelane_controllers.card import Aim, ControllerCard, PaperCard, PaperValue, TransferCard

CARD = ControllerCard(
    controller='spikelane_controllers.dqn_snn.controller:DqnSnn',
    title='DQN-SNN',
    transfer=TransferCard(
        source='dqn',
        transfer='spikelane_controllers.dqn_snn.policy_transfer:PolicyTransfer',
        results='spikelane_controllers.dqn_snn.results:TransferResults',
        requires='learn',
    ),
    weights=Path(__file__).parent / 'weights',
    nir_graph='spikelane_controllers.dqn_snn.nir_export:export_nir',
    paper=PaperCard(
        order=1,
        laps=('1', '2'),
        learnt=('1', '2'),
        values=(
            PaperValue('1', 'accuracy', 0.9305, '93.05 %', 'section 5.2'),
            PaperValue('2', 'accuracy', 0.9171, '91.71 %', 'section 5.2'),
            PaperValue('1', 'mean_abs_distance_m', None, 'below 0.041 m', 'section 6'),
        ),
    ),
    aims=(
        Aim('1', 'accuracy', 0.931, is_lowest=True),
        Aim('2', 'accuracy', 0.92, is_lowest=True),
        Aim('3', 'accuracy', 0.9, is_lowest=True),
        Aim('2', 'mean_abs_distance_m', 0.04),
    ),
)
