"""What a simulator drives and sees with: the parts that parameters change while it drives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spikelane_sim.camera import Camera, CameraModel
from spikelane_sim.communication_link import CommunicationLink
from spikelane_sim.conditions.schedule import Schedule
from spikelane_sim.contract import link_rng, Robot, simulator_rng, WheelVelocities
from spikelane_sim.course import Course
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import Events
from spikelane_sim.pixels import make_pixel_model
from spikelane_sim.pixels.dead import dead_pixels, without_dead
from spikelane_sim.robots import make_robot
from spikelane_sim.robots.wheel_errors import UnequalWheels
from spikelane_sim.simulator_parameters import SimulatorParameters


class Devices:
    """Robot, camera, pixels, and the link between them and the controller.

    Attributes:
        robot: The robot.
        camera: The camera.
    """

    def __init__(
        self,
        schedule: Schedule,
        course: Course,
        robot: Robot | None = None,
        camera: CameraModel | None = None,
    ) -> None:
        """Make what is not given.

        Args:
            schedule: Parameters, and which of them change.
            course: What the camera sees first.
            robot: As in `Simulator`.
            camera: As in `Simulator`.

        Raises:
            SpikelaneError: A combination of parameters cannot be simulated.
        """
        parameters = schedule.parameters
        size = parameters.camera
        self._size = size.width, size.height
        self._pixels = make_pixel_model(parameters.pixels, *self._size)
        self.camera: CameraModel = camera or Camera(size, course)
        self._own_camera = None if camera else self.camera
        for name in schedule.changing:
            if camera and name.startswith(('camera.', 'markings', 'course')):
                raise ParameterError(f'{name}: expected no change of a camera that is given')
        images = self._pixels.images_per_step
        self.robot = robot or make_robot(parameters.robot, images, parameters.period_s)
        self._wheels: UnequalWheels | None = None
        if schedule.has_wheel_errors:
            self.robot = self._wheels = UnequalWheels(self.robot)
        self._link = CommunicationLink(parameters.link, parameters.period_ms)
        self._dead: NDArray[np.bool_] | None = None
        self.change(parameters, course)

    def change(self, parameters: SimulatorParameters, course: Course) -> None:
        """Go on with other parameters.

        Args:
            parameters: All of them.
            course: Whose markings are seen.
        """
        pixels = parameters.pixels
        self._pixels.adopt(pixels)
        if isinstance(self._own_camera, Camera):
            self._own_camera.look(parameters.camera, course)
        if self._wheels is not None:
            self._wheels.errors = parameters.robot.wheel_errors
        self._link.parameters = parameters.link
        self._dead = None
        if pixels.dead_share:
            self._dead = dead_pixels(pixels.dead_share, pixels.dead_seed, *self._size)

    def reset(self, seed: int, episode: int) -> None:
        """Begin an episode, of which all chance follows from these two."""
        self.forget_image(seed, episode)
        self._link.reset(link_rng(seed, episode))

    def forget_image(self, seed: int, episode: int) -> None:
        """Let the pixels forget what they saw."""
        self._pixels.reset(simulator_rng(seed, episode))

    def drive(self, wheels: WheelVelocities) -> NDArray[np.float64]:
        """Send a command, and drive for a step with the one that arrives; return the poses."""
        return self.robot.step(self._link.carry_command(wheels))

    def see(self, poses: NDArray[np.float64], start_ns: int, end_ns: int) -> Events:
        """Return the events of a step that reach the controller.

        Args:
            poses: Poses of the body when the images of the step are taken, (n, 7).
            start_ns: Simulation time before the step [ns].
            end_ns: The same after it.
        """
        events = self._pixels.step(self.camera.render_many(poses), start_ns, end_ns)
        if self._dead is not None:
            events = without_dead(events, self._dead, self._size[0])
        return self._link.carry_events(events)
