"""Node `dqn`: drives with a learnt Q-network, or learns it."""

from __future__ import annotations

import sys

from spikelane_controllers.nodes.learning import LearningNode
from spikelane_sim.nodes.running import run_node


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: LearningNode('dqn')))


if __name__ == '__main__':
    main()
