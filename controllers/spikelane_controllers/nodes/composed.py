"""`python -m spikelane_controllers.nodes.composed NAME`: simulator and controller in one process.

Both nodes have the names, topics, services and parameters that they have in processes of their
own. What they send each other stays in the process (`spikelane_sim.nodes.local_topics`).
"""

from __future__ import annotations

import sys

from spikelane_sim_entry import take_signals


def main() -> None:
    """Run the nodes; the first argument is the name of the controller."""
    if len(sys.argv) < 2:
        sys.exit('python -m spikelane_controllers.nodes.composed: expected a controller')
    take_signals()
    # Here and not above: what is imported takes its time.
    from spikelane_controllers.nodes.main import make_node
    from spikelane_sim.nodes.local_topics import LocalTopics
    from spikelane_sim.nodes.running import run_nodes
    from spikelane_sim.nodes.simulator import SimulatorNode

    name = sys.argv.pop(1)
    local = LocalTopics()
    sys.exit(run_nodes((lambda: SimulatorNode(local), lambda: make_node(name, local))))


if __name__ == '__main__':
    main()
