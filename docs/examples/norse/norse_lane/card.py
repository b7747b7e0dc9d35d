"""What Spikelane must know of the controller; PyTorch is not loaded for it."""

from spikelane_controllers.card import ControllerCard

CARD = ControllerCard(controller='norse_lane.controller:NorseLane', title='Norse')
