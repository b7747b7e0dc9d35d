#!/usr/bin/env python3
"""How fast the controllers drive: data, tables and figure of speed.md.

source setup/env.sh; docs/results/speed.py drive docs/results/speed.csv
source setup/env.sh; docs/results/speed.py collect docs/results/speed.csv runs/speed
source setup/env.sh; docs/results/speed.py show docs/results/speed.csv FIGURE.png

The first command drives what the file lacks, part by part, or only the parts that are named after
the file; it is deterministic. The second one adds laps with the networks that
experiments/speed.yaml has trained. The third one prints the tables and draws the figure.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
import sys
from typing import Any, NamedTuple

from matplotlib.axes import Axes
import numpy as np
from numpy.typing import NDArray
import pandas as pd

from spikelane.fleet import Fleet
from spikelane.loop import drive_episode
from spikelane.statistics import mean_statistics
from spikelane_controllers.registry import make_controller
from spikelane_sim.contract import TERMINATED_LAPS_COMPLETE
from spikelane_sim.figure_style import (
    INK,
    LEFT,
    new_figure,
    PALE_INK,
    RIGHT,
    save,
    SERIES,
    settings,
    write_title,
)
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

SCENARIOS = (1, 2, 3)
LANES = ('outer', 'inner')
#: Seeds of the map, and of the goals.
FEW, MANY = range(3), range(10)
#: Seeds of the laps differ from those of the trainings.
LAP_SEED = 1000
PERIODS_MS = (50, 20, 10, 5)
#: Control periods and latencies of the map [ms].
CELLS = (*((period_ms, 0) for period_ms in PERIODS_MS), (10, 50), (10, 100), (10, 200))
#: Speeds asked for on a straight lane: the last one is the top speed of a P3-DX [m/s].
SPEEDS_M_S = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
WHEEL_M = 0.0975
#: The wheels' mean velocity on a straight lane [rad/s] at `speed` 1.
STRAIGHT_RAD_S = {'rstdp': 1.5, 'braitenberg': 1.5, 'dqn': 1.0, 'dqn_snn': 1.0}
TITLES = {
    'rstdp': 'R-STDP',
    'braitenberg': 'Braitenberg',
    'dqn': 'DQN',
    'dqn_snn': 'DQN-SNN',
}
SHIPPED, TRAINED = 'shipped', 'trained at this speed'
P3DX = 'p3dx'
#: What R-STDP is trained for [s]: as long as 15,000 steps of 50 ms.
TRAINING_S = 750.0
#: The networks of experiments/speed.yaml.
FAST_NETWORKS: dict[str, dict[str, Any]] = {
    'dqn': {'image.frames': 1, 'task.steps_per_action': 1, 'averaged': True},
    'dqn_snn': {'encoding.frames': 1, 'trace_decay': 0.3},
}
#: A robot with a racing car's speed, its tyres and how hard it turns.
RACER_URDF = 'docs/examples/robot/racer.urdf'
RACER = {'robot.pybullet.wheel_friction': 1.5, 'robot.max_sideways_m_s2': 10.5}
RACER_WHEEL_M = 0.0508
#: Its steering, with time constants of learning that are shorter as it is faster.
RACER_STEERING = {
    'steering.v_max': 4.5 / RACER_WHEEL_M,
    'steering.v_min': 4.2 / RACER_WHEEL_M,
    'steering.turn': 0.8 / RACER_WHEEL_M,
    'poisson.max_events': 30,
    'synapse.tau_c_ms': 50.0,
    'synapse.tau_n_ms': 20.0,
}
#: Its training: the reward, and for how long [s].
RACER_TRAINING = ((0.2, 300.0), (0.05, 200.0), (0.01, 200.0))


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
            return found | RACER_STEERING
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


def main() -> None:
    """Drive, collect, or show."""
    if len(sys.argv) < 3 or sys.argv[1] not in ('drive', 'collect', 'show'):
        sys.exit(__doc__)
    data = Path(sys.argv[2])
    if sys.argv[1] == 'show':
        show(pd.read_csv(data), Path(sys.argv[3]))
    elif sys.argv[1] == 'collect':
        append(data, 'networks', collect(Path(sys.argv[3])))
    else:
        for name, part in parts().items():
            if len(sys.argv) > 3 and name not in sys.argv[3:]:
                continue
            if not data.exists() or name not in set(pd.read_csv(data)['part']):
                append(data, name, part())


def append(data: Path, part: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write the rows of a part, in place of those that there were."""
    found = pd.DataFrame([{'part': part, **row} for row in rows])
    if data.exists():
        others = pd.read_csv(data)
        found = pd.concat([others[others['part'] != part], found])
    found.to_csv(data, index=False, float_format='%.6g')


def parts() -> dict[str, Callable[[], list[dict[str, Any]]]]:
    """Return what is driven, part by part."""
    found: dict[str, Callable[[], list[dict[str, Any]]]] = {'goal': goal, 'racer': racer}
    for controller in STRAIGHT_RAD_S:
        found[f'map {controller}'] = partial(shipped_map, controller)
    for period_ms, latency_ms in CELLS:
        name = f'map trained, {period_ms} ms, {latency_ms} ms'
        found[name] = partial(trained_map, period_ms, latency_ms)
    return found | {'errors': errors}


def goal() -> list[dict[str, Any]]:
    """Train R-STDP at the top speed of the P3-DX, and drive with both engines."""
    rows = []
    for scenario in SCENARIOS:
        setting = Setting('rstdp', TRAINED, 1.2, 10)
        weights, losses = train(setting, scenario, MANY)
        rows += drive(setting, scenario, MANY, weights, losses)
        rows += drive(setting._replace(engine='pybullet'), scenario, MANY, weights, losses)
    return rows


def racer() -> list[dict[str, Any]]:
    """Train R-STDP on the racer in scenario 1, and drive with both engines."""
    rows = []
    setting = Setting('rstdp', TRAINED, 4.5, 10, robot=RACER_URDF)
    weights, losses = None, [0] * len(MANY)
    for c_r, seconds in RACER_TRAINING:
        weights, more = train(setting, 1, MANY, c_r=c_r, seconds=seconds, begin=weights)
        losses = [sum(pair) for pair in zip(losses, more, strict=True)]
    rows += drive(setting, 1, MANY, weights, losses)
    rows += drive(setting._replace(engine='pybullet'), 1, MANY, weights, losses)
    return rows


def shipped_map(controller: str) -> list[dict[str, Any]]:
    """Find the highest speed at which the shipped weights lap, by period and latency."""
    rows = []
    scenarios = (1,) if controller == 'braitenberg' else SCENARIOS
    for period_ms, latency_ms in CELLS:

        def laps(asked: float, period: int = period_ms, late: int = latency_ms) -> bool:
            setting = Setting(controller, SHIPPED, asked, period, late)
            driven = [row for each in scenarios for row in drive(setting, each, FEW)]
            rows.extend(driven)
            return all(row['completed'] for row in driven)

        bisect(laps)
    return rows


def bisect(laps: Callable[[float], bool]) -> None:
    """Look for the highest of SPEEDS_M_S with which all laps are completed."""
    low, high = -1, len(SPEEDS_M_S) - 1
    if laps(SPEEDS_M_S[high]):
        return
    while high - low > 1:
        middle = (low + high) // 2
        if laps(SPEEDS_M_S[middle]):
            low = middle
        else:
            high = middle


def trained_map(period_ms: int, latency_ms: int) -> list[dict[str, Any]]:
    """Train R-STDP at the top speed of the P3-DX, with a period and a latency."""
    rows = []
    for scenario in SCENARIOS:
        setting = Setting('rstdp', TRAINED, 1.2, period_ms, latency_ms)
        weights, losses = train(setting, scenario, FEW)
        rows += drive(setting, scenario, FEW, weights, losses)
    return rows


def errors() -> list[dict[str, Any]]:
    """Drive scenario 1 at each speed: with the shipped weights, and trained at that speed."""
    rows = []
    for asked in SPEEDS_M_S:
        for controller in STRAIGHT_RAD_S:
            rows += drive(Setting(controller, SHIPPED, asked, 50), 1, FEW)
        if asked in (0.4, 0.8):
            continue
        setting = Setting('rstdp', TRAINED, asked, 10)
        weights, losses = train(setting, 1, FEW)
        rows += drive(setting, 1, FEW, weights, losses)
    return rows


def train(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    *,
    c_r: float = 0.01,
    seconds: float = TRAINING_S,
    begin: Sequence[NDArray[np.float64]] | None = None,
) -> tuple[list[NDArray[np.float64]], list[int]]:
    """Train R-STDP, over episodes that end at 0.2 m from the centre.

    Args:
        setting: Who drives how.
        scenario: Number of the course.
        seeds: Seeds of the trainings.
        c_r: The reward.
        seconds: How long.
        begin: Weights to begin with; None for those that are drawn.

    Returns:
        The weights of each training, and how often it lost the lane.
    """
    course = setting.simulator(scenario) | {'episode.max_distance_m': 0.2, 'episode.max_steps': 0}
    learning = setting.parameters(scenario) | {'learning': True, 'checkpoint': ''}
    learning['c_r'] = c_r
    steps = round(seconds * 1000 / setting.period_ms)
    losses = [0] * len(seeds)
    with Fleet('rstdp', seeds, simulator=course, parameters=learning) as fleet:
        fleet.initialise()
        host(fleet, begin or ())
        for end in fleet.drive(steps):
            losses[end.robot] += end.lane_state.reason != TERMINATED_LAPS_COMPLETE
        weights = [np.array(fleet.controller(robot).weights_pa) for robot in range(len(seeds))]
    return weights, losses


def host(fleet: Fleet, weights: Sequence[NDArray[np.float64]]) -> None:
    """Give each robot's controller its weights, where there are any."""
    for robot, each in enumerate(weights):
        controller = fleet.controller(robot)
        controller.restore({**controller.state(), 'network.weights_pa': each})
        fleet.load(robot)


def drive(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]] = (),
    losses: Sequence[int] = (),
) -> list[dict[str, Any]]:
    """Drive a lap of each lane with each seed, learning off.

    Args:
        setting: Who drives how.
        scenario: Number of the course.
        seeds: Seeds of the laps, less LAP_SEED.
        weights: Of R-STDP, for each seed; none for the shipped ones.
        losses: Lane losses of the training, for each seed.
    """
    in_fleet = setting.engine == 'rigid' and setting.controller != 'dqn_snn'
    one = _fleet_laps if in_fleet else _single_laps
    # A Q-network has no randomness of its own.
    used = seeds[:1] if setting.controller == 'dqn' else seeds
    rows = []
    for lane in LANES:
        found = one(setting, scenario, used, weights, lane)
        for seed, result in zip(used, found, strict=True):
            row = {**setting._asdict(), 'scenario': scenario, 'lane': lane, 'seed': seed}
            rows.append(row | result | ({'losses': losses[seed]} if losses else {}))
    return rows


def _fleet_laps(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]],
    lane: str,
) -> list[dict[str, Any]]:
    lap_seeds = [LAP_SEED + seed for seed in seeds]
    given = {
        'simulator': setting.simulator(scenario),
        'parameters': setting.parameters(scenario),
    }
    with Fleet(setting.controller, lap_seeds, **given) as fleet:
        host(fleet, weights)
        tracks = fleet.episodes([lane] * len(lap_seeds))
    return [_result(track.end, track.places['distance_m'], setting.period_ms) for track in tracks]


def _single_laps(
    setting: Setting,
    scenario: int,
    seeds: Sequence[int],
    weights: Sequence[NDArray[np.float64]],
    lane: str,
) -> list[dict[str, Any]]:
    rows = []
    parameters = SimulatorParameters.from_mapping(setting.simulator(scenario))
    for number, seed in enumerate(seeds):
        controller: Any = make_controller(setting.controller, setting.parameters(scenario))
        if weights:
            state = controller.state()
            controller.restore({**state, 'network.weights_pa': weights[number]})
        distances: list[float] = []
        with Simulator(parameters) as driven:
            last = drive_episode(
                driven,
                controller,
                lambda observation, _, to=distances: to.append(observation.lane.distance_m),
                lane=lane,
                seed=LAP_SEED + seed,
                controller_seed=LAP_SEED + seed,
            )
        rows.append(_result(last.lane, distances, setting.period_ms))
    return rows


def _result(end: Any, distances_m: Any, period_ms: int) -> dict[str, Any]:
    """Return how a lap went."""
    return {
        'completed': end.reason == TERMINATED_LAPS_COMPLETE,
        'error_m': float(np.abs(distances_m).mean()),
        'speed_m_s': end.progress_m / (max(len(distances_m) - 1, 1) * period_ms / 1000),
    }


def collect(runs: Path) -> list[dict[str, Any]]:
    """Drive with the networks that experiments/speed.yaml has trained, a lap of each lane."""
    rows = []
    for kind, controller in (('train', 'dqn'), ('transfer', 'dqn_snn')):
        for folder in sorted(runs.glob(f'{kind}-{controller}-*')):
            if not (folder / 'metrics.json').exists():
                continue  # it is not over
            scenario = int(folder.name.split('-')[2])
            seed = int(folder.name.rsplit('seed', 1)[1])
            setting = Setting(controller, str(folder), 9 * WHEEL_M, 50)
            for row in drive(setting, scenario, (seed,)):
                rows.append({**row, 'weights': TRAINED})
    return rows


def show(data: pd.DataFrame, path: Path) -> None:
    """Print the tables and draw the figure."""
    data = data.assign(completed=data['completed'].astype(bool))
    print(f'| {" | ".join(_GOAL_COLUMNS)} |')
    print('|---' * len(_GOAL_COLUMNS) + '|')
    for part in ('goal', 'racer', 'networks'):
        of = data[data['part'] == part]
        for _, laps in of.groupby(['controller', 'engine', 'scenario', 'lane'], sort=False):
            print(f'| {" | ".join(goal_cells(laps))} |')
    print()
    table = highest(data)
    rows = table.pivot_table(
        index=['controller', 'weights'], columns=['latency_ms', 'period_ms'], values='asked_m_s'
    )
    print(rows.round(2).to_string())
    with settings():
        figure = new_figure(9.4, 4.4)
        write_title(figure, "Laps of the paper's course by speed", 'mean of both lanes')
        draw_errors(figure.add_axes((0.07, 0.28, 0.5, 0.6)), data)
        draw_highest(figure.add_axes((0.69, 0.28, 0.29, 0.6)), table)
        save(figure, path)


_GOAL_COLUMNS = ('controller', 'engine', 'scenario', 'lane', 'laps', 'mean speed', 'mean error')


def goal_cells(laps: pd.DataFrame) -> list[str]:
    """Return a row of the table: one setting and lane, over seeds."""
    first, done = laps.iloc[0], laps[laps['completed']]
    robot = '' if first['robot'] == P3DX else ', racer'
    cells = [TITLES[first['controller']] + robot, first['engine'], first['scenario']]
    cells += [first['lane'], f'{len(done)} of {len(laps)}']
    if done.empty:
        return [*map(str, cells), 'none', 'none']
    error = mean_statistics(done['error_m'].tolist(), done['seed'].tolist(), low=0.0)
    assert error is not None  # there is a value
    text = f'{error["mean"] * 1000:.1f}'
    if error['ci_low'] is not None:
        text = f'{text} ({error["ci_low"] * 1000:.1f} to {error["ci_high"] * 1000:.1f})'
    text = f'{text}, at most {error["max"] * 1000:.1f} mm'
    return [*map(str, cells), f'{done["speed_m_s"].mean():.2f} m/s', text]


def highest(data: pd.DataFrame) -> pd.DataFrame:
    """Return the highest speed asked for with which all laps were completed; 0 for none."""
    is_goal = (data['part'] == 'goal') & (data['engine'] == 'rigid')
    of = data[data['part'].str.startswith('map') | is_goal]
    keys = ['controller', 'weights', 'period_ms', 'latency_ms']
    every = of.groupby([*keys, 'asked_m_s'])['completed'].all().reset_index()
    every['asked_m_s'] = every['asked_m_s'].where(every['completed'], 0.0)
    return every.groupby(keys)['asked_m_s'].max().reset_index()


def draw_errors(axes: Axes, data: pd.DataFrame) -> None:
    """Draw the errors in scenario 1 over the speed, where all laps were completed."""
    of = data[(data['scenario'] == 1) & (data['engine'] == 'rigid') & (data['latency_ms'] == 0)]
    # The shipped weights with a period of 50 ms, those of R-STDP that are trained with 10 ms.
    is_shipped = of['weights'] == SHIPPED
    of = of[(is_shipped & (of['period_ms'] == 50)) | (~is_shipped & (of['part'].str[:3] != 'map'))]
    of = of.drop_duplicates(['controller', 'weights', 'asked_m_s', 'lane', 'seed', 'robot'])
    of = of.assign(error_m=of['error_m'].where(of['completed']))
    for (controller, weights), rows in of.groupby(['controller', 'weights']):
        points = rows.groupby(['robot', 'asked_m_s']).agg(
            speed=('speed_m_s', 'mean'), error=('error_m', 'mean'), done=('completed', 'mean')
        )
        points = points[points['done'] >= ALMOST_ALL].sort_values('speed')
        is_trained = weights == TRAINED
        axes.plot(
            points['speed'], points['error'] * 1000, color=COLOURS[controller],
            marker='o' if is_trained else 'x', linestyle='none' if is_trained else ':',
            label=f'{TITLES[controller]}, {weights}', linewidth=1.3, markersize=5.5,
        )  # fmt: skip
    axes.axvline(1.2, color=PALE_INK, linewidth=0.8)
    axes.annotate(
        'limit of the P3-DX', (1.2, 0.0), xycoords=('data', 'axes fraction'), fontsize=8,
        color=PALE_INK, ha='right', va='bottom', xytext=(-4, 3), textcoords='offset points',
    )  # fmt: skip
    axes.annotate(
        'racer', (4.06, 0.0), xycoords=('data', 'axes fraction'), fontsize=8, color=PALE_INK,
        ha='center', va='bottom', xytext=(0, 3), textcoords='offset points',
    )  # fmt: skip
    axes.set_xscale('log')
    axes.set_xlim(0.1, 5)
    ticks = (0.1, 0.2, 0.5, 1, 2, 4)
    axes.set_xticks(ticks, [f'{tick:g}' for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(bottom=0)
    axes.set_xlabel('mean speed of the laps of scenario 1 [m/s]')
    axes.set_ylabel('mean error [mm]')
    axes.legend(
        loc='upper left', bbox_to_anchor=(-0.1, -0.2), ncols=4, frameon=False, fontsize=7.5
    )


def draw_highest(axes: Axes, table: pd.DataFrame) -> None:
    """Draw the highest speed by control period, without latency."""
    of = table[table['latency_ms'] == 0]
    for number, ((controller, weights), rows) in enumerate(of.groupby(['controller', 'weights'])):
        places = [PERIODS_MS.index(period) + 0.06 * (number - 2) for period in rows['period_ms']]
        axes.plot(
            places, rows['asked_m_s'], color=COLOURS[controller],
            marker='o' if weights == TRAINED else 'x', linestyle='none', markersize=6,
        )  # fmt: skip
    axes.set_xticks(range(len(PERIODS_MS)), [str(period) for period in PERIODS_MS])
    axes.set_ylim(-0.05, 1.3)
    axes.set_xlabel('control period [ms]')
    axes.set_ylabel('highest speed with which all\nlaps are completed [m/s]')
    axes.grid(axis='y', linewidth=0.4)


#: Share of laps completed from which on their mean error is drawn.
ALMOST_ALL = 0.8
COLOURS = dict(zip(TITLES, (LEFT, INK, RIGHT, SERIES[2]), strict=True))


if __name__ == '__main__':
    main()
