"""Where the `spikelane` command and its nodes begin; see `spikelane_sim_entry`."""

import sys

from spikelane_sim_entry import take_signals


def main() -> None:
    """Run the command and exit; `spikelane.main` takes notice of signals once it is imported."""
    take_signals()
    from spikelane.main import main as run

    run()


def recorder() -> None:
    """Run the node and exit."""
    take_signals()
    from spikelane.nodes.recorder import main as run

    sys.exit(run())


def replay() -> None:
    """Run the node and exit."""
    take_signals()
    from spikelane.runs.replay.nodes.replay import main as run

    run()


def viewer() -> None:
    """Run the node and exit."""
    take_signals()
    from spikelane.nodes.viewer import main as run

    run()


def camera_calibration() -> None:
    """Run the node and exit."""
    take_signals()
    from spikelane.nodes.camera_calibration import main as run

    run()


def wheels_to_twist() -> None:
    """Run the node and exit."""
    take_signals()
    from spikelane.nodes.wheels_to_twist import main as run

    run()


def lane_from_pose() -> None:
    """Run the node and exit."""
    take_signals()
    from spikelane.nodes.lane_from_pose import main as run

    run()
