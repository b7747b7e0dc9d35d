"""Node `learning_balance`."""

import sys

from spikelane_controllers.nodes.learning import LearningNode
from spikelane_sim.nodes.running import run_node


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: LearningNode('learning_balance')))
