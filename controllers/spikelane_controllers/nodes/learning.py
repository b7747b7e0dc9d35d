"""Node of a controller that can learn: drives with the weights it has, or trains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
import time
from typing import Any, cast

from event_camera_msgs.msg import EventPacket
from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.task import Future
from spikelane_msgs.msg import LaneState, Weights
from spikelane_msgs.srv import Reset

from spikelane_controllers.learning.learning_controller import (
    check_can_learn,
    check_learning_parameters,
    LearningController,
)
from spikelane_controllers.learning.robot_episodes import RobotEpisodes
from spikelane_controllers.learning.scalar_log import LOG_FOLDER, ScalarLog
from spikelane_controllers.learning.training import Training
from spikelane_controllers.nodes.controller import ControllerNode
from spikelane_controllers.nodes.robot_lane import LANE_TOPICS, RobotLane
from spikelane_controllers.registry import controller_class, training_card, training_class
from spikelane_controllers.shown import shown_by
from spikelane_sim import contract, messages, topic_names
from spikelane_sim.binning import SensorStep
from spikelane_sim.contract import Controller, Observation
from spikelane_sim.errors import ParameterError
from spikelane_sim.nodes import conversions
from spikelane_sim.nodes.kept_publisher import KeptPublisher
from spikelane_sim.nodes.ros_parameters import declare_parameter, declare_parameters, given_value
from spikelane_sim.parameters import parameter, Parameters
from spikelane_sim.simulator_parameters import EpisodeParameters

WEIGHTS_EVERY_STEPS = 100
# The window in which a controller waits for a recorder has room for fewer.
_WEIGHTS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@dataclass(frozen=True, kw_only=True)
class LearningNodeParameters(Parameters):
    """Where a training is kept."""

    output: str = parameter(
        '', 'Folder for the checkpoints of the training; required for learning.'
    )
    resume: bool = parameter(False, 'Resume the training in the folder.')
    lane_source: str = parameter(
        'simulator',
        'Where the distance from the lane comes from in learning. simulator: lane/state with '
        'each observation, and simulator/reset begins episodes. On a robot: lane/distance '
        '(distance) or lane/state (state), from whatever node, and a person begins episodes '
        'with ~/begin_episode.',
        choices=('simulator', *LANE_TOPICS),
    )
    lane_name: str = parameter(
        'lane', 'Name of the lane on a robot, where lane_source is distance.'
    )
    lost_beyond_m: float = parameter(
        0.0,
        "Distance from the lane's centre that ends an episode on a robot; 0: that of the "
        "controller's training in simulation.",
        unit='m',
        low=0.0,
        high=100.0,
    )


class LearningNode(ControllerNode):
    """Drives, or trains: it then resets the simulator to each episode and ends when all is done.

    What the simulator publishes before its first reset took effect is not answered. On a robot a
    person takes the place of the simulator's reset, see `RobotLane`.
    """

    @property
    def _training(self) -> Training | None:
        """The training, None where the controller only drives."""
        return self._controller if isinstance(self._controller, Training) else None

    def _check_cut_short(self, number: int) -> None:
        super()._check_cut_short(number)
        training = self._training
        if training is not None and not training.is_done:
            self._cut_short(
                number,
                f'after {training.steps} of {training.parameters.steps} steps; resume goes on '
                'from the last checkpoint',
            )

    def _other_publishers(self) -> tuple[KeptPublisher, ...]:
        return (*super()._other_publishers(), self._weights)

    @property
    def _may_change(self) -> bool:
        # A training's checkpoint promises the parameters that it began with.
        return not self._is_training

    def _make_driver(self, name: str) -> Controller:
        self._weights = KeptPublisher(self, Weights, topic_names.WEIGHTS, _WEIGHTS)
        specs = {spec.name: spec for spec in controller_class(name).parameters_class.specs()}
        check_learning_parameters(name, specs)
        given = given_value(self, 'learning')  # a wrong one is refused where it is declared
        self._is_training = (specs['learning'].default if given is None else given) is True
        if self._is_training:
            # A training begins without weights, unless configured otherwise.
            declare_parameter(self, replace(specs['checkpoint'], default=''))
        return super()._make_driver(name)

    def _wrap_driver(self, name: str, driver: Controller) -> Controller:
        self._learning = settings = declare_parameters(self, LearningNodeParameters)
        check_can_learn(name, driver)
        driver = cast(LearningController, driver)
        self._controller_name = name
        cls = training_class(name)
        parameters = declare_parameters(self, cls.parameters_class)
        self._publish_weights(driver, 0)
        if not driver.learning:
            return driver
        if not settings.output:
            raise ParameterError("output: expected the folder of the training, got ''")
        self._check_lane_source()
        config = {
            'controller': name,
            'seed': self._settings.seed,
            name: driver.parameters.to_dict(),
            'filter': self._settings.filter.chosen(),
            'save_every': parameters.save_every,
        }
        folder = Path(settings.output)
        checkpoint = folder / 'checkpoint.safetensors'
        training = cls(name, driver, parameters, config, checkpoint)
        if settings.resume:
            training.resume(can_repeat=settings.lane_source == 'simulator')
        else:
            training.begin(self._settings.seed)
        ScalarLog(folder / LOG_FOLDER, training, time.monotonic)
        # The client is made before the subscriptions. A service drops an answer to a client that
        # it has not met within 0.1 s; a simulator that waits for our subscriptions has met the
        # client before it answers.
        if settings.lane_source == 'simulator':
            self._client = self.create_client(Reset, 'simulator/reset')
        return training

    @property
    def _is_on_robot(self) -> bool:
        """Whether it learns without a simulator."""
        return self._training is not None and self._learning.lane_source != 'simulator'

    def _check_lane_source(self) -> None:
        source, settings = self._learning.lane_source, self._settings
        if source == 'simulator':
            if not settings.use_lane_state:
                raise ParameterError(
                    'use_lane_state: expected true, since the reward depends on it; on a robot '
                    'lane_source says where the distance from the lane comes from'
                )
            return
        if settings.use_lane_state:
            raise ParameterError(f'use_lane_state: expected false with lane_source {source}')
        if settings.command == 'wheels':
            raise ParameterError(
                f'command: expected twist or twist_stamped with lane_source {source}, since '
                'learning pauses while the base may not drive, got wheels'
            )

    def _watched(self) -> tuple[str, ...]:
        lanes = (LANE_TOPICS[self._learning.lane_source],) if self._is_on_robot else ()
        return (*super()._watched(), *lanes)

    def _observation(
        self, step: SensorStep, state: contract.LaneState | None
    ) -> Observation | None:
        if self._lane_of_robot is None:
            return super()._observation(step, state)
        lane = self._lane_of_robot.next()
        return None if lane is None else super()._observation(step, lane)

    def _make_robot_lane(self, training: Training) -> RobotLane:
        assert self._base is not None  # as was checked
        settings = self._learning
        defaults = training_card(self._controller_name).defaults
        lost_m = settings.lost_beyond_m or float(
            defaults.get('simulator.episode.max_distance_m', EpisodeParameters().max_distance_m)
        )
        return RobotLane(
            self,
            settings.lane_source,
            settings.lane_name,
            RobotEpisodes(lost_m, training.start.episode),
            self._base,
            self._lock,
            training.end_episode,
        )

    def _start(self) -> None:
        self._first_stamp_ns: int | None = None  # of the training's first episode, to wait for
        self._lane_of_robot: RobotLane | None = None
        if self._training is None:
            super()._start()
        elif self._is_on_robot:
            self._lane_of_robot = self._make_robot_lane(self._training)
            super()._start()
        elif self._has_learnt:
            self.context.try_shutdown()
        else:
            # Steady time: that of the simulator does not pass before it is reset.
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._search = self.create_timer(0.1, self._reset_if_there, clock=steady)

    def _lacks(self) -> str:
        if self._is_on_robot:
            return super()._lacks()
        if self._training is not None and not self._client.service_is_ready():
            return 'waiting to reset the simulator: no service simulator/reset is found'
        return super()._lacks()

    def _reset_if_there(self) -> None:
        if self._client.service_is_ready():
            self._search.cancel()
            assert self._training is not None  # only a training searches for the simulator
            lane, episode = self._training.start
            request = Reset.Request(lane=lane or '', seed=self._settings.seed, episode=episode)
            self._client.call_async(request).add_done_callback(self._on_first_reset)

    def _on_first_reset(self, answer: Future) -> None:
        response = answer.result()
        if not response.success:
            self.get_logger().fatal(f'simulator/reset: {response.message}')
            self.exit_status = 1
            self.context.try_shutdown()
            return
        self._first_stamp_ns = messages.to_stamp_ns(response.stamp)
        super()._start()

    def _on_observation(self, lane: LaneState | None, packet: EventPacket) -> None:
        if self._first_stamp_ns not in (None, messages.to_stamp_ns(packet.header.stamp)):
            return
        self._first_stamp_ns = None
        if not self._has_learnt:  # the next observation may be here before the node has ended
            super()._on_observation(lane, packet)
        if self._has_learnt:
            self._stop_base()
            self._meeting.end(is_cut_short=False)
            self.is_done = True
            if self.executor is not None:
                self.executor.wake()

    @property
    def _has_learnt(self) -> bool:
        return self._training is not None and self._training.is_done

    def _step(self, observation: Observation) -> None:
        super()._step(observation)
        observed = self._steps + 1  # this one included
        if (
            observed % WEIGHTS_EVERY_STEPS == 0
            and self._weights.subscribers
            and cast(LearningController, self._driver).learning
        ):
            self._publish_weights(self._driver, observation.stamp_ns)
        training = self._training
        if training is not None and training.needs_reset and not self._is_on_robot:
            # Its answer is not waited for: the first observation comes by itself.
            self._client.call_async(Reset.Request(lane='', seed=-1))

    def _publish_weights(self, driver: Any, stamp_ns: int) -> None:
        weights_pa = shown_by(driver).weights_pa
        if weights_pa is None:  # too many to be looked at
            return
        message = Weights(name='weights', shape=list(weights_pa.shape), unit='pA')
        message.header.stamp = conversions.to_time(stamp_ns)
        message.data = weights_pa.ravel().tolist()
        self._weights.publish(message)
