"""Node `rstdp`: drives with learnt weights, or learns to."""

from __future__ import annotations

import sys

from spikelane_controllers.nodes.learning import LearningNode
from spikelane_sim.nodes.running import run_node


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: LearningNode('rstdp')))


if __name__ == '__main__':
    main()
