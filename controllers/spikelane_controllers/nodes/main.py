"""The node of any registered controller: the executable has the controller's name.

A package that adds a controller may name this `main` in its `console_scripts`, so that
`ros2 run` finds the node; `spikelane` runs it without, as `__main__.py` does.
"""

from __future__ import annotations

from pathlib import Path
import sys
from typing import TYPE_CHECKING

from spikelane_sim_entry import take_signals

if TYPE_CHECKING:
    from spikelane_controllers.nodes.controller import ControllerNode
    from spikelane_sim.nodes.local_topics import LocalTopics


def main(name: str | None = None) -> None:
    """Run the node of a controller.

    Args:
        name: The controller; None is the one that the executable is named after.
    """
    take_signals()
    # Here and not above: what is imported takes its time.
    from spikelane_sim.nodes.running import run_node

    controller = name or Path(sys.argv[0]).name
    sys.exit(run_node(lambda: make_node(controller)))


def make_node(name: str, local: LocalTopics | None = None) -> ControllerNode:
    """Make the node of a controller.

    Args:
        name: In the registry.
        local: As of `ControllerNode`.

    Raises:
        SpikelaneError: No controller has this name, or a parameter is not allowed.
    """
    from spikelane_controllers.nodes.controller import ControllerNode
    from spikelane_controllers.nodes.learning import LearningNode
    from spikelane_controllers.registry import card

    return (LearningNode if card(name).training else ControllerNode)(name, local)
