"""The Braitenberg controller as a whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from spikelane.runs.configuration import Request
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.metrics import lap_metrics
from spikelane.runs.lap.run import drive_lap
from spikelane_controllers.braitenberg.controller import (
    Braitenberg,
    braitenberg_weights,
    BraitenbergParameters,
)
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import make_events, no_events
from spikelane_sim.period import PERIOD_NS

CONFIG = Path(__file__).parents[4] / 'controllers' / 'config' / 'braitenberg.yaml'


def observation(columns: tuple[int, int], number: int = 200, seed: int = 0) -> Observation:
    """Make random events between two columns, in the lowest row of cells."""
    return in_rows((88, 104), columns, number, seed)


def in_rows(
    rows: tuple[int, int], columns: tuple[int, int] = (0, 128), number: int = 200, seed: int = 0
) -> Observation:
    """Make random events between two rows of pixels and two columns."""
    rng = np.random.default_rng(seed)
    x_px, y_px = rng.integers(*columns, number), np.sort(rng.integers(*rows, number))
    return Observation(PERIOD_NS, make_events(PERIOD_NS, x_px, y_px, 1), None)


Answer = tuple[WheelVelocities, tuple[int, ...]]


def drive(controller: Braitenberg, steps: int = 20) -> list[Answer]:
    """Answer the same kind of scene again and again."""
    return [
        (controller.step(observation((0, 128), 60, seed)), controller.spikes)
        for seed in range(steps)
    ]


def test_weights_of_the_right_neuron_mirror_those_of_the_left() -> None:
    """Bottom rows written out; the other half of the image has no say."""
    left, right = braitenberg_weights(BraitenbergParameters()).reshape(2, 4, 8)
    assert left[0].tolist() == [250, 250, 250, 500, 0, 0, 0, 0]
    assert left[3].tolist() == [500, 1000, 1500, 2000, 0, 0, 0, 0]
    assert right[3].tolist() == [0, 0, 0, 0, 2000, 1500, 1000, 500]
    assert left.tolist() == right[:, ::-1].tolist()


def test_events_on_the_left_drive_the_left_neuron_and_turn_right() -> None:
    """And the other way round."""
    controller = Braitenberg()
    controller.reset(np.random.default_rng(1))
    wheels = controller.step(observation((0, 64)))
    assert controller.spikes[0] > 10
    assert controller.spikes[1] == 0
    assert wheels.left > wheels.right
    controller.reset(np.random.default_rng(1))
    wheels = controller.step(observation((64, 128)))
    assert controller.spikes[0] == 0
    assert controller.spikes[1] > 10
    assert wheels.left < wheels.right


def test_only_the_lowest_row_of_cells_excites_the_neurons() -> None:
    """Pixel rows 88 to 103 from the top, which are 24 to 39 from the bottom."""
    controller = Braitenberg()
    controller.step(in_rows((0, 88)))
    assert (controller.spikes, controller.operations.synaptic) == ((0, 0), 0)
    controller.step(in_rows((104, 128)))
    assert controller.spikes == (0, 0)
    controller.step(in_rows((88, 89)))
    assert min(controller.spikes) > 10
    controller.reset(np.random.default_rng(0))
    controller.step(in_rows((103, 104)))
    assert min(controller.spikes) > 10


def test_more_rows_can_excite_them() -> None:
    """Two rows begin at pixel row 72, all four at 40."""
    for rows, above, first in ((2, (40, 72), (72, 88)), (4, (0, 40), (40, 56))):
        controller = Braitenberg(BraitenbergParameters(lowest_rows=rows))
        controller.step(in_rows(above))
        assert controller.operations.synaptic == 0
        controller.step(in_rows(first))
        assert controller.operations.synaptic > 0
    with pytest.raises(ParameterError, match=r'lowest_rows: expected at most the 4 rows .* got 5'):
        BraitenbergParameters(lowest_rows=5)


@pytest.mark.parametrize(('lane', 'error_m'), [('outer', 0.048), ('inner', 0.031)])
def test_it_laps_both_lanes_on_the_right_of_their_centre(lane: str, error_m: float) -> None:
    """Three laps of scenario 1 each; the errors are those that the README tells of."""
    config = [
        LapConfig.make(
            Request('1', 'braitenberg', seed, 'inprocess', {'simulator.robot.model': 'kinematic'}),
            lane,
        )
        for seed in range(3)
    ]
    laps = [lap_metrics(drive_lap(each, lambda *_: None).trajectory, 0.05) for each in config]
    assert all(lap['completed'] for lap in laps)
    assert np.mean([lap['mean_abs_distance_m'] for lap in laps]) == pytest.approx(
        error_m, abs=0.006
    )
    assert all(lap['mean_distance_m'] > 0.01 for lap in laps)


def test_a_spike_takes_one_millisecond_to_the_neuron() -> None:
    """There is no relay on its way; with one it takes longer."""
    assert BraitenbergParameters().delays.steps == 10
    relayed = BraitenbergParameters.from_mapping({'delays.to_relay_ms': 1.0})
    assert relayed.delays.steps == 20


def test_without_events_it_drives_straight_at_the_smallest_speed() -> None:
    """Until something is seen."""
    controller = Braitenberg()
    assert controller.step(Observation(PERIOD_NS, no_events(), None)) == (1.0, 1.0)
    assert controller.spikes == (0, 0)


def test_the_same_seed_gives_the_same_bits() -> None:
    """In another controller, or in the same one after a reset: nothing is left over."""
    one, other = Braitenberg(), Braitenberg()
    one.reset(np.random.default_rng(5))
    other.reset(np.random.default_rng(5))
    first = drive(one)
    assert drive(other) == first
    one.reset(np.random.default_rng(5))
    assert drive(one) == first
    one.reset(np.random.default_rng(6))
    assert drive(one) != first


def test_a_reset_clears_spikes_and_spikes_in_flight() -> None:
    """A neuron that was driven hard stays silent after it."""
    controller = Braitenberg()
    controller.step(observation((0, 128), 600))
    controller.reset(np.random.default_rng(1))
    assert controller.spikes == (0, 0)
    assert controller.step(Observation(PERIOD_NS, no_events(), None)) == (1.0, 1.0)
    assert controller.spikes == (0, 0)


def test_events_are_only_read() -> None:
    """Read-only events are taken, and nothing is written to others."""
    seen = observation((0, 128))
    before = seen.events.tobytes()
    controller = Braitenberg()
    controller.step(seen)
    assert seen.events.tobytes() == before
    seen.events.flags.writeable = False
    controller.step(seen)


def test_the_file_of_parameters_holds_every_default() -> None:
    """The YAML file and the dataclasses agree in both directions."""
    values = yaml.safe_load(CONFIG.read_text())['/**']['ros__parameters']
    from_file = BraitenbergParameters.from_mapping(values)
    assert from_file == BraitenbergParameters()
    named = set()
    for name, value in values.items():
        named |= {f'{name}.{key}' for key in value} if isinstance(value, dict) else {name}
    assert named == {spec.name for spec in BraitenbergParameters.specs()}


def test_the_papers_values_are_the_defaults() -> None:
    """500 Hz at 10 events, 25 spikes at full activity."""
    values = BraitenbergParameters().to_dict()
    assert values['poisson.max_rate_hz'] == 500.0
    assert values['poisson.max_events'] == 10
    assert values['steering.n_max'] == 25
    assert values['lowest_rows'] == 1
    assert sum(values['weights_pa']) == 11_500


def test_a_wrong_number_of_weights_is_refused() -> None:
    """The message says how many there must be."""
    with pytest.raises(ParameterError, match='weights_pa: expected 4 x 4 weights, got 2'):
        BraitenbergParameters(weights_pa=(1.0, 2.0))


def test_an_odd_number_of_columns_has_no_halves() -> None:
    """A sensor of 112 columns has 7 columns of cells."""
    with pytest.raises(ParameterError, match='expected an even number of columns, got 7'):
        BraitenbergParameters.from_mapping({'encoding.width': 112})
