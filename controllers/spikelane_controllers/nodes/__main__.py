"""`python -m spikelane_controllers.nodes NAME`: the node of a controller without an executable.

Such is a controller of a package that pip has installed, of which ROS knows nothing.
"""

from __future__ import annotations

import sys

from spikelane_controllers.nodes.main import main

if __name__ == '__main__':
    if len(sys.argv) < 2:
        sys.exit('python -m spikelane_controllers.nodes: expected the name of a controller')
    main(sys.argv.pop(1))
