"""Node `balance`."""

import sys

from spikelane_controllers.nodes.controller import ControllerNode
from spikelane_sim.nodes.running import run_node


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: ControllerNode('balance')))
