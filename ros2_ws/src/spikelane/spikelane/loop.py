"""The one loop: a simulator and a controller, observation by observation."""

from __future__ import annotations

from collections.abc import Callable

from spikelane.interruption import check
from spikelane_sim.contract import Controller, controller_rng, Observation, WheelVelocities
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.simulator import Simulator

OnStep = Callable[[Observation, WheelVelocities], None]


def drive_episode(
    simulator: Simulator,
    controller: Controller,
    on_step: OnStep,
    *,
    lane: str | None = None,
    seed: int | None = None,
    controller_seed: int = 0,
    filters: FilterParameters | None = None,
) -> Observation:
    """Drive one episode to its end.

    Args:
        simulator: Is reset first.
        controller: Is reset first; is given every observation, the last one included.
        on_step: Called with each observation and its answer, before the next step.
        lane: As in `Simulator.reset`.
        seed: As in `Simulator.reset`.
        controller_seed: Seed of the controller's randomness.
        filters: What events go through before the controller is given them; None for no filter.
            `on_step` is given the events of the camera.

    Returns:
        The last observation.

    Raises:
        SpikelaneError: No such lane, a negative seed, or a filter cannot be made.
        Interrupted: A signal has come.
    """
    camera = simulator.parameters.camera
    stage = FilterStage(filters or FilterParameters(), camera.width, camera.height)
    observation = simulator.reset(lane, seed)
    assert observation.lane is not None  # a simulator always knows it
    controller.reset(controller_rng(controller_seed, observation.lane.episode))
    while True:
        wheels = controller.step(stage.observe(observation))
        on_step(observation, wheels)
        check()
        if observation.lane is not None and observation.lane.terminated:
            return observation
        observation = simulator.step(wheels)
