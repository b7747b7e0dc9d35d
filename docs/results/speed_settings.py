"""Who drives how in speed.py: speeds, control periods, robots, and their parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

PERIODS_MS = (50, 20, 10, 5)
WHEEL_M = 0.0975
#: The wheels' mean velocity on a straight lane [rad/s] at `speed` 1.
STRAIGHT_RAD_S = {'rstdp': 1.5, 'braitenberg': 1.5, 'dqn': 1.0, 'dqn_snn': 1.0}
#: `simulator.speed` of the networks of experiments/speed.yaml.
NETWORK_SPEED = 8.5
SHIPPED, TRAINED = 'shipped', 'trained at this speed'
P3DX = 'p3dx'
#: A robot with a racing car's speed, its tyres and how hard it turns.
RACER_URDF = 'docs/examples/robot/racer.urdf'
RACER = {
    'robot.pybullet.wheel_friction': 1.5,
    'robot.max_sideways_m_s2': 10.5,
    'camera.pitch_deg': 25.0,
}
RACER_WHEEL_M = 0.0508


#: Parameters of the networks of experiments/speed.yaml.
FAST_NETWORKS: dict[str, dict[str, Any]] = {
    'dqn': {
        'image.frames': 8,
        'image.frame_ms': 10,
        'task.steps_per_action': 2,
        'task.step_ms': 10,
        'averaged': True,
    },
    'dqn_snn': {
        'encoding.frames': 8,
        'encoding.frame_ms': 10,
        'neurons.simulated_ms': 50.0,
        'neurons.reset': 'subtract',
        'trace_decay': 0.02,
    },
}


class Setting(NamedTuple):
    """Who drives how."""

    controller: str
    weights: str
    asked_m_s: float
    period_ms: int
    latency_ms: int = 0
    robot: str = P3DX
    engine: str = 'rigid'

    def simulator(self, scenario: int) -> dict[str, Any]:
        """Return the simulator's parameters."""
        found = {
            'robot.engine': self.engine,
            'robot.model': self.robot,
            'course': f'scenario_{scenario}',
            'period_ms': self.period_ms,
            'link.latency_ms': self.latency_ms,
            'episode.max_steps': round(400_000 / self.period_ms / self.asked_m_s),
        }
        if self.weights != TRAINED:
            straight_m_s = STRAIGHT_RAD_S[self.controller] * WHEEL_M
            found['speed'] = self.asked_m_s / straight_m_s
        return found | (RACER if self.robot.endswith('racer.urdf') else {})

    def parameters(self, scenario: int) -> dict[str, Any]:
        """Return the controller's parameters."""
        found: dict[str, Any] = {'period_ms': self.period_ms}
        if self.weights == SHIPPED:
            shipped = {'checkpoint': f'scenario_{scenario}'}
            return found | ({} if self.controller == 'braitenberg' else shipped)
        if self.weights != TRAINED:
            return found | FAST_NETWORKS[self.controller] | {'checkpoint': self.weights}
        if self.robot != P3DX:
            return found | racer_network(self.asked_m_s)
        return found | fast_steering(self.asked_m_s)


def fast_steering(asked_m_s: float) -> dict[str, float]:
    """Return the steering of R-STDP that is trained at a speed.

    In curves it is hardly slower than on straight lanes, and turns twice as much as the paper's
    at the same speed would on the P3-DX.
    """
    v_max = asked_m_s / WHEEL_M
    return {
        'steering.v_max': v_max,
        'steering.v_min': 0.96 * v_max,
        'steering.turn': 0.244 * v_max,
    }


def racer_network(asked_m_s: float) -> dict[str, float]:
    """Return the steering and the network of R-STDP on the racer at a speed.

    Speed and turn follow the neurons faster than the paper's, and a reward acts for a shorter
    time. In curves the racer is as fast as on straight lanes.
    """
    v_max = asked_m_s / RACER_WHEEL_M
    return {
        'steering.n_max': 8,
        'steering.v_max': v_max,
        'steering.v_min': v_max,
        'steering.turn': 0.24 * v_max,
        'poisson.max_events': 10,
        'synapse.tau_c_ms': 130.0,
        'synapse.tau_n_ms': 15.0,
    }
