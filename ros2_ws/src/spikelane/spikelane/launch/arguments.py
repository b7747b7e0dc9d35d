"""The arguments of launch files: how they are declared and what was given."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
from typing import Any

from launch import LaunchContext
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration

from spikelane.runs.lap.config import NO_PROGRESS_S
from spikelane_controllers.registry import controller_names, usual_controller
from spikelane_sim.period import PERIOD_MS


class Arguments:
    """The arguments of a launch, as they were given."""

    def __init__(self, context: LaunchContext) -> None:
        self._context = context

    def text(self, name: str) -> str:
        """Return an argument; one that the launch file does not have is empty."""
        return str(LaunchConfiguration(name, default='').perform(self._context))

    def number(self, name: str) -> int:
        """Return an argument that is a whole number.

        Raises:
            ValueError: It is not.
        """
        try:
            return int(self.text(name))
        except ValueError:
            raise ValueError(f'{name}: expected a whole number, got {self.text(name)!r}') from None

    @property
    def pushed_namespace(self) -> str | None:
        """The full namespace that the launch is included in; None where there is none."""
        pushed = self._context.launch_configurations.get('ros_namespace')
        return None if pushed is None else str(pushed)

    def positive(self, name: str) -> float | None:
        """Return an argument that is a positive number; None where it is empty.

        Raises:
            ValueError: It is not.
        """
        text = self.text(name)
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 < value < math.inf:
            raise ValueError(f'{name}: expected a positive number, got {text!r}')
        return value

    @property
    def period_ms(self) -> int | None:
        """The control period; None for that of the parameter files."""
        return self.number('period_ms') if self.text('period_ms') else None

    def is_true(self, name: str) -> bool:
        """Return an argument that is true or false."""
        return self.text(name) == 'true'


def argument(
    name: str, description: str, default: str | None = None, choices: Sequence[str] | None = None
) -> DeclareLaunchArgument:
    """Declare an argument; one without a default must be given."""
    return DeclareLaunchArgument(
        name,
        description=description,
        default_value=default,
        choices=None if choices is None else list(choices),
    )


def flag(name: str, description: str, default: bool) -> DeclareLaunchArgument:
    """Declare an argument that is true or false."""
    return argument(name, description, str(default).lower(), ('true', 'false'))


def run_arguments(record: bool = True) -> list[DeclareLaunchArgument]:
    """Declare what any run takes; `record` is whether it is usually recorded."""
    return [
        argument('scenario', "The paper's scenario.", '1', ('1', '2', '3')),
        argument('seed', 'Seed of all randomness, a whole number from 0.', '0'),
        argument(
            'simulator_file',
            "The simulator's parameters; empty: the scenario's of the package.",
            '',
        ),
        period_argument('simulator and controller'),
        argument(
            'speed',
            'Factor on all wheel velocities that the controller asks for; empty: that of '
            'simulator_file.',
            '',
        ),
        argument('bag', 'Folder to record to, must not exist; empty: rosbag2_<date>-<time>.', ''),
        flag('composed', 'Run simulator and controller as two nodes of one process.', False),
        flag('record', 'Record the run in a bag.', record),
        flag('viewer', 'Show the run in the browser; Ctrl-C then ends all.', False),
        argument(
            'wait_for_subscribers',
            'Subscribers that event_camera/events and wheel_velocities must have before anything '
            'is published, those of this launch included; 0: those of this launch alone.',
            '0',
        ),
        argument(
            'history_depth',
            'Messages kept for a subscriber that is late, as of ros2 bag record; 0: as usual.',
            '0',
        ),
    ]


def period_argument(whose: str) -> DeclareLaunchArgument:
    """Declare the control period of some nodes."""
    return argument(
        'period_ms',
        f'Control period of {whose}, 5 to 50 ms; empty: that of the parameter files.',
        '',
    )


def lap_arguments() -> list[DeclareLaunchArgument]:
    """Declare what determines a lap beyond what any run takes; see `lap_parameters`."""
    return [
        argument('lane', "Lane to drive, outer or inner; empty: the course's first.", ''),
        argument('max_steps', 'Number of steps that end a lap early; 0: none.', '0'),
    ]


def lap_parameters(arguments: Arguments) -> dict[str, Any]:
    """Return the parameters of a simulator that drives one lap."""
    return {
        'lane': arguments.text('lane'),
        'episode.max_steps': arguments.number('max_steps'),
        'episode.no_progress_steps': round(
            NO_PROGRESS_S * 1000 / (arguments.period_ms or PERIOD_MS)
        ),
        'end_after_episodes': 1,
    }


def namespace_argument() -> DeclareLaunchArgument:
    """Declare the namespace of all nodes."""
    return argument(
        'namespace',
        'Namespace of all nodes and topics, with /clock and /tf in it; empty: none.',
        '',
    )


def controller_arguments(
    controllers: Iterable[str] | None = None, default: str | None = None
) -> list[DeclareLaunchArgument]:
    """Declare which controller takes part, and with which parameters.

    Args:
        controllers: To choose from; None: all.
        default: The usual one; None: that of the commands.
    """
    names = controller_names() if controllers is None else tuple(controllers)
    return [
        argument('controller', 'What drives.', default or usual_controller(), names),
        argument(
            'controller_file', "The controller's parameters; empty: those of the package.", ''
        ),
    ]
