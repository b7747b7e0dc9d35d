"""What determines a replay."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from spikelane.runs.configuration import (
    check_seed,
    configured_controller,
    make_groups,
    Request,
    RunConfig,
)
from spikelane.runs.lap.config import default_weights
from spikelane_controllers.registry import controller_class
from spikelane_sim.binning import SensorParameters
from spikelane_sim.contract import (
    sensors_of,
)
from spikelane_sim.course import load_course, scenario_course
from spikelane_sim.filters import FilterParameters
from spikelane_sim.parameters import Parameters


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReplayConfig(RunConfig):
    """What determines a replay.

    Attributes:
        bag: Folder or file.
        events_topic: Where the events are from; None for the usual topic.
        controller: Name in the controllers' registry.
        scenario: Whose shipped weights a controller has that learns.
        seed: Seed of the controller's randomness.
        use_lane_state: Whether the controller receives lane states, and reset by them.
        controller_parameters: Parameters of the controller's own class.
        sensor: How event packets become steps.
        filter: What events go through before that.
    """

    bag: Path
    events_topic: str | None
    controller: str
    scenario: str
    seed: int
    use_lane_state: bool
    controller_parameters: Parameters
    sensor: SensorParameters
    filter: FilterParameters

    @property
    def usual_name(self) -> str:
        """As in RunConfig."""
        return f'replay-{self.controller}-seed{self.seed}'

    def check(self) -> None:
        """Make sure that there is what answers.

        Raises:
            SpikelaneError: The controller cannot be made.
        """
        configured_controller(self)

    @classmethod
    def make(
        cls,
        asked: Request,
        bag: Path,
        *,
        events_topic: str | None = None,
        use_lane_state: bool = True,
    ) -> ReplayConfig:
        """Make the configuration of a replay.

        Args:
            asked: Its scenario says which shipped weights a controller has that learns; its
                parameters are the controller's, and the sensor's as `sensor.crop_left`.
            bag: As in ReplayConfig.
            events_topic: As in ReplayConfig.
            use_lane_state: As in ReplayConfig.

        Raises:
            SpikelaneError: Anything is unknown or not allowed.
        """
        load_course(scenario_course(asked.scenario))  # refuses one that is not there
        controller = asked.controller
        groups = make_groups(
            {**default_weights(asked.scenario, controller), **asked.parameters},
            {
                controller: controller_class(controller).parameters_class,
                'sensor': SensorParameters,
                'filter': FilterParameters,
            },
        )
        check_seed(asked.seed)
        return cls(
            given=asked.parameters,
            bag=Path(bag),
            events_topic=events_topic,
            controller=controller,
            scenario=asked.scenario,
            seed=asked.seed,
            use_lane_state=use_lane_state,
            controller_parameters=groups.pop(controller),
            **groups,
        )


def uses_encoders(config: ReplayConfig) -> bool:
    """Return whether the controller uses wheel encoders."""
    return 'encoders' in sensors_of(controller_class(config.controller))
