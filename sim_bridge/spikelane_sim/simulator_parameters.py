"""The parameters of a simulation: everything that determines it but its seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from spikelane_sim.camera import ANTIALIAS_ROWS, CameraParameters
from spikelane_sim.communication_link import LinkParameters
from spikelane_sim.conditions.perturbation import PerturbationParameters
from spikelane_sim.conditions.randomisation import ENDS, RandomisationParameters
from spikelane_sim.parameters import check_size, nested, parameter, Parameters
from spikelane_sim.period import PERIOD_MS, TimedParameters
from spikelane_sim.pixels import PixelParameters
from spikelane_sim.robots import P3DX, RobotParameters
from spikelane_sim.robots.registry import values_of


@dataclass(frozen=True, kw_only=True)
class EpisodeParameters(Parameters):
    """When an episode ends."""

    max_distance_m: float = parameter(
        0.5,
        'The episode ends when the robot is farther than this from the lane centre; 0: never.',
        unit='m',
        low=0.0,
        high=1000.0,
        source='paper section 3.3 (0.2 for R-STDP, section 4.2)',
    )
    max_laps: int = parameter(
        1, 'Number of laps after which the episode ends; 0: never.', low=0, high=1_000_000
    )
    max_steps: int = parameter(
        0,
        'Number of steps, each of a control period, after which the episode ends; 0: never.',
        low=0,
        high=2**31 - 1,
    )
    no_progress_steps: int = parameter(
        0,
        'The episode ends when the farthest progress along the lane has grown by less than '
        'min_progress_m within this many steps, each of a control period; 0: never.',
        low=0,
        high=2**31 - 1,
    )
    min_progress_m: float = parameter(
        0.1,
        'Progress that the robot must make within no_progress_steps.',
        unit='m',
        low=0.001,
        high=1000.0,
    )


#: Most samples of the ground in a step; images with so many pixels take half a gigabyte.
MOST_SAMPLES = 2**27


@dataclass(frozen=True, kw_only=True)
class SimulatorParameters(TimedParameters):
    """Everything that determines a simulation but its seed."""

    course: str = parameter(
        'scenario_1', 'Name of a shipped course, path of a course file, or random:SEED.'
    )
    markings: str = parameter(
        '',
        "Course whose markings are seen in place of the course's own, as `course`; its lanes must "
        'be the same.',
    )
    speed: float = parameter(
        1.0,
        'Factor on all wheel velocities of a controller, taken before the limit of the robot.',
        low=0.01,
        high=100.0,
    )
    episode: EpisodeParameters = nested(EpisodeParameters)
    robot: RobotParameters = nested(RobotParameters)
    camera: CameraParameters = nested(CameraParameters)
    pixels: PixelParameters = nested(PixelParameters)
    link: LinkParameters = nested(LinkParameters)
    randomisation: RandomisationParameters = nested(RandomisationParameters)
    perturbation: PerturbationParameters = nested(PerturbationParameters)

    @classmethod
    def chosen_defaults(cls, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """As in Parameters: the values of the robot that `robot.model` names."""
        model = values_of(str(values.get('robot.model', P3DX)))
        if model is None:
            return {}
        drive = {f'robot.{name}': value for name, value in model.drive.items()}
        return drive | {f'camera.{name}': value for name, value in model.camera.items()}

    def _check_relations(self) -> None:
        self.link.latency_steps(self.period_ms)
        size = {'camera.width': self.camera.width, 'camera.height': self.camera.height}
        rows = ANTIALIAS_ROWS if self.camera.antialias else 1
        self.pixels.check_sizes(size)
        images = self.pixels.images_per_step
        check_size(
            'samples of the ground in a step',
            {**size, 'rows (camera.antialias)': rows, 'images (pixels.esim.substeps)': images},
            MOST_SAMPLES,
        )
        self._check_changes()

    def _check_changes(self) -> None:
        """Refuse values that an episode or a perturbation cannot have."""
        usual: dict[str, Any] = {'randomisation.enabled': False, 'perturbation.changes': []}
        if self.randomisation.enabled:
            values = self.to_dict()
            for place in ENDS:
                drawn = self.randomisation.chosen(values, place)
                SimulatorParameters.from_mapping({**values, **drawn, **usual}, 'randomisation')
        if changes := self.perturbation.values():
            changed = {**self.to_dict(), **changes, **usual}
            SimulatorParameters.from_mapping(changed, 'perturbation.changes')


_ESIM = 'pixels.esim.'
_LATER = (
    f'{_ESIM}hot_',
    'pixels.dead_',
    'camera.yaw_deg',
    'camera.contrast',
    'robot.left_wheel_factor',
    'robot.right_wheel_factor',
    'robot.track_factor',
    'markings',
    'randomisation.',
    'perturbation.',
)
#: What runs had before there were these parameters.
_FORMER = {
    spec.name: list(spec.default) if spec.kind is tuple else spec.default
    for spec in SimulatorParameters.specs()
    if spec.name.startswith(_LATER)
}


def current_config(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return what determined a run, its simulator's parameters under today's names."""
    values = config.get('simulator')
    if not isinstance(values, Mapping):
        return dict(config)
    # What earlier versions did not name was as the default is.
    found = {'period_ms': PERIOD_MS, 'speed': 1.0, **SimulatorParameters.current(values)}
    if any(name.startswith(_ESIM) for name in found):  # all are there
        found = {**_FORMER, **found}
    return {**config, 'simulator': found}


def period_ms_of(config: Mapping[str, Any]) -> int:
    """Return the control period of a run, 50 ms where its configuration does not say any."""
    values = config.get('simulator')
    return int(values.get('period_ms', PERIOD_MS)) if isinstance(values, Mapping) else PERIOD_MS
