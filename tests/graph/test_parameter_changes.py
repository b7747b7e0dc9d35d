"""Parameters set while the processes of a lap run: the same bits, recorded, and told."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import json
from pathlib import Path
import time
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from simulation_interfaces.msg import SimulationState
from simulation_interfaces.srv import SetSimulationState, StepSimulation

from spikelane.bag.drive import RecordedDrive
from spikelane.main import run
from spikelane.nodes.graph import Supervisor
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.nodes import driving
from spikelane.runs.lap.run import drive_lap, DrivenLap, report_lap
from spikelane.runs.lap.trajectory import Trajectory, TrajectoryRecorder
from spikelane_controllers.controller_host import ControllerHost
from spikelane_controllers.registry import make_controller
from spikelane_sim.simulator import Simulator

pytestmark = pytest.mark.ros

SEED = 3
STEPS = 150
AGAIN_S = 3.0
USUAL = {'simulator.robot.model': 'kinematic', 'simulator.episode.max_steps': STEPS}
SIMULATOR = {
    'pixels.coppelia.noise_rate_hz': 0.05,
    'link.latency_ms': 50,
    'link.event_loss': 0.1,
}
CONTROLLER = {'learning': True, 'c_r': 0.02}


class Client:
    """Calls services of the nodes of a lap."""

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service; return the response."""
        client = self._supervisor._node.create_client(kind, name)
        self._supervisor.wait_for(name, client.service_is_ready)
        answer = None
        # A service drops its answer to a client that it has not met within 0.1 s.
        while answer is None or not answer.done():
            answer, asked_s = client.call_async(kind.Request(**fields)), time.monotonic()
            while not answer.done() and time.monotonic() - asked_s < AGAIN_S:
                self._supervisor.spin()
        self._supervisor._node.destroy_client(client)
        return answer.result()

    def set(self, node: str, values: Mapping[str, Any]) -> str:
        """Set parameters of a node, all at once; return the reason."""
        wanted = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        name = f'/{node}/set_parameters_atomically'
        result = self.call(SetParametersAtomically, name, parameters=wanted).result
        assert result.successful, result.reason
        return str(result.reason)

    def set_state(self, state: int) -> None:
        """Pause the simulation, or let it go on."""
        wanted = SimulationState(state=state)
        self.call(SetSimulationState, '/simulator/set_simulation_state', state=wanted)


def config(transport: str, steps: int = STEPS, **others: Any) -> LapConfig:
    """Return a lap of so many steps."""
    usual = {**USUAL, 'simulator.episode.max_steps': steps, **others}
    return LapConfig.make(Request('1', 'rstdp', SEED, transport, usual), 'inner')


def drive(
    folder: Path,
    asked: LapConfig,
    monkeypatch: pytest.MonkeyPatch,
    before: Callable[[Client], None] = lambda each: None,
    amid: Callable[[Client], None] = lambda each: None,
) -> tuple[DrivenLap, RunFolder]:
    """Drive a lap over ROS; call functions before its episode and in it."""
    drive_episode, called = driving._drive_episode, []

    def with_changes(config: Any, seed: int, supervisor: Supervisor, show: Any) -> float:
        before(Client(supervisor))

        def call_once(step: int, progress_m: float) -> None:
            if not called:
                called.append(step)
                amid(Client(supervisor))

        return drive_episode(config, seed, supervisor, call_once)

    monkeypatch.setattr(driving, '_drive_episode', with_changes)
    made = RunFolder.create(folder, numbered=False)
    return driving.drive_lap_over_ros(asked, made, lambda step, progress_m: None), made


def assert_same(one: Trajectory, other: Trajectory) -> None:
    """Check that two drives are the same, bit for bit."""
    assert len(one) == len(other)
    for column in ('x_m', 'y_m', 'distance_m', 'events', 'left_rad_s', 'right_rad_s'):
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column))


@pytest.mark.parametrize('transport', ['ros', 'composed'])
def test_parameters_set_before_an_episode_give_the_lap_of_a_start_with_them(
    tmp_path: Path, transport: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Noise, latency, loss, learning and its rate, in two processes or in one; told at the end."""
    reasons = []

    def before(client: Client) -> None:
        reasons.append(client.set('simulator', SIMULATOR))
        reasons.append(client.set('rstdp', CONTROLLER))

    asked = config(transport)
    driven, folder = drive(tmp_path / 'lap', asked, monkeypatch, before)
    assert reasons == [
        'pixels.coppelia.noise_rate_hz from the next step on, link.latency_ms from the next '
        'step on, link.event_loss from the next step on',
        'learning from the next step on, c_r from the next step on',
    ]
    others = {f'simulator.{name}': value for name, value in SIMULATOR.items()}
    others |= {f'rstdp.{name}': value for name, value in CONTROLLER.items()}
    expected = drive_lap(config('inprocess', **others), lambda step, progress_m: None)
    assert_same(driven.trajectory, expected.trajectory)
    usual = drive_lap(config('inprocess'), lambda step, progress_m: None)
    assert not np.array_equal(usual.trajectory.y_m, expected.trajectory.y_m)
    notes = [
        'parameters of /simulator were changed in the drive: pixels.coppelia.noise_rate_hz = '
        '0.05, link.latency_ms = 50, link.event_loss = 0.1 from 0.05 s on',
        'parameters of /rstdp were changed in the drive: learning = True, c_r = 0.02 from '
        '0.05 s on',
    ]
    report_lap(asked, driven, folder)
    assert json.loads(folder.metrics.read_text())['notes'] == notes


def test_parameters_set_amid_a_lap_are_recorded_and_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The bag says with which observation; made again there, the drive is the same."""
    steps = 300

    def before(client: Client) -> None:
        client.set_state(SimulationState.STATE_PAUSED)

    def amid(client: Client) -> None:
        client.call(StepSimulation, '/simulator/step_simulation', steps=30)
        client.set('rstdp', CONTROLLER)
        client.set('simulator', SIMULATOR)
        client.call(StepSimulation, '/simulator/step_simulation', steps=50)
        client.set('rstdp', {'learning': False})
        client.set_state(SimulationState.STATE_PLAYING)

    asked = config('ros', steps, **{'simulator.episode.max_laps': 0})
    driven, folder = drive(tmp_path / 'lap', asked, monkeypatch, before, amid)
    changes = RecordedDrive(folder.bag).changes
    assert [each.change.values for each in changes.controller] == [
        {'learning': True, 'c_r': 0.02},
        {'learning': False},
    ]
    (change,) = (each.change for each in changes.simulator)
    assert change.values == SIMULATOR
    at = {each.change.stamp_ns: each.change.values for each in changes.controller}
    first_ns, second_ns = at
    assert 30 * 50_000_000 < first_ns < second_ns - 40 * 50_000_000
    controller = make_controller('rstdp', asked.controller_parameters.to_dict())
    host, recorder = ControllerHost(controller, SEED, controller.parameters), TrajectoryRecorder()
    with Simulator(asked.simulator) as simulator:
        observation = simulator.reset('inner', SEED)
        while True:
            host.changing.change(at.get(observation.stamp_ns, {}))
            wheels = host.step(observation)
            recorder.append(observation, simulator.robot_state, wheels)
            if observation.lane.terminated:
                break
            is_next = observation.stamp_ns + 50_000_000 == change.stamp_ns
            simulator.change(change.values if is_next else {})
            observation = simulator.step(wheels)
    assert_same(driven.trajectory, recorder.trajectory())
    assert run(['replay', str(folder.bag), '--json', '--out', str(tmp_path / 'replay')]) == 0
    replayed = json.loads(capsys.readouterr().out)
    assert replayed['agreement'] == 1.0
    assert 'the changes are made again where they took effect' in replayed['notes']
