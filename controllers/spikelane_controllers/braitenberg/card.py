"""The card of the Braitenberg controller."""

from spikelane_controllers.card import ControllerCard, PaperCard, PaperValue

CARD = ControllerCard(
    controller='spikelane_controllers.braitenberg.controller:Braitenberg',
    fleet='spikelane_controllers.braitenberg.fleet:BraitenbergFleet',
    title='Braitenberg',
    is_usual=True,
    figures='spikelane_controllers.braitenberg.figures:figures',
    paper=PaperCard(
        order=2,
        laps=('1',),
        values=(PaperValue('1', 'mean_abs_distance_m', None, "like DQN's", 'section 6'),),
    ),
)
