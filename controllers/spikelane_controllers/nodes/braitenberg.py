"""Node `braitenberg`: drives with two neurons whose weights are set by hand."""

from __future__ import annotations

import sys

from spikelane_controllers.nodes.controller import ControllerNode
from spikelane_sim.nodes.running import run_node


def main() -> None:
    """Run the node."""
    sys.exit(run_node(lambda: ControllerNode('braitenberg')))


if __name__ == '__main__':
    main()
