"""Node `dqn_snn`: drives with a policy that has been transferred to a spiking network."""

from __future__ import annotations

import sys

from spikelane_controllers.nodes.controller import ControllerNode
from spikelane_sim.nodes.running import run_node


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: ControllerNode('dqn_snn')))


if __name__ == '__main__':
    main()
