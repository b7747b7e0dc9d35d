"""What Spikelane must know of the controllers of this package."""

from spikelane_controllers.card import ControllerCard, TrainingCard

BALANCE = ControllerCard(
    controller='my_controllers.balance:Balance',
    title='Balance',
)

METERED = ControllerCard(
    controller='my_controllers.metered:Metered',
    title='Balance with encoders',
)

LEARNING_BALANCE = ControllerCard(
    controller='my_controllers.learning_balance:LearningBalance',
    title='Learning balance',
    training=TrainingCard(defaults={'simulator.episode.max_laps': 1}),
)
