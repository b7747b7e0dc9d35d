"""The DQN-SNN controller as a whole, and the files its network comes from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file
import yaml

from spikelane_controllers.checkpoint import read_checkpoint, write_checkpoint
from spikelane_controllers.dqn_snn.controller import (
    DqnSnn,
    DqnSnnParameters,
    input_values,
    value_per_event,
)
from spikelane_controllers.dqn_snn.feedforward import FeedForward
from spikelane_controllers.dqn_snn.normalisation import normalise
from spikelane_controllers.dqn_snn.transferred import (
    export_transferred,
    InputScale,
    read_transferred,
    Transferred,
    write_transferred,
)
from spikelane_controllers.weights import shipped_weights
from spikelane_sim.contract import Observation
from spikelane_sim.errors import CheckpointError, ParameterError
from spikelane_sim.events import make_events, no_events
from spikelane_sim.period import PERIOD_NS

CONFIG = Path(__file__).parents[4] / 'controllers' / 'config' / 'dqn_snn.yaml'
INPUTS = 512


def single(*arrays: np.ndarray) -> FeedForward:
    """Make a network of arrays."""
    return FeedForward(*(np.asarray(each, np.float32) for each in arrays))


def by_sides() -> FeedForward:
    """Make a network that steers towards an event at (10, 60) or (100, 60).

    Cells of 4 x 4 pixels, 40 rows cropped: row 5, columns 2 and 25. A third hidden neuron fires
    every eighth time step, by its bias alone, for straight on.
    """
    hidden = np.zeros((3, INPUTS))
    hidden[0, 5 * 32 + 2] = hidden[1, 5 * 32 + 25] = 1.0
    return single(hidden, [0.0, 0.0, 0.125], [[1, 0, 0], [0, 0, 1], [0, 1, 0]])


def save(folder: Path, network: FeedForward, maximum: int = 10, frames: int = 10) -> str:
    """Write a network as a transfer's checkpoint; return the path."""
    file = folder / 'checkpoint.safetensors'
    transferred = Transferred(network, InputScale(frames, maximum))
    write_transferred(
        file, network, transferred, {'config': {'seed': 0, 'checkpoint': '/home/x/dqn'}}
    )
    return str(file)


def events_at(*pixels: tuple[int, int]) -> Observation:
    """Make an observation of events at (x, y)."""
    x_px, y_px = (np.array(each) for each in zip(*sorted(pixels, key=lambda p: p[1]), strict=True))
    return Observation(PERIOD_NS, make_events(PERIOD_NS, x_px, y_px, 1), None)


@pytest.fixture(scope='module')
def random_network(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Give a normalised network of random weights."""
    rng = np.random.default_rng(0)
    drawn = single(rng.normal(1, 1, (20, INPUTS)), rng.normal(size=20), rng.normal(1, 1, (3, 20)))
    return save(tmp_path_factory.mktemp('network'), normalise(drawn).network, maximum=40)


def test_a_value_of_one_is_what_makes_it_in_the_data_set() -> None:
    """There the largest count in ten frames was 40: 4 in each frame."""
    scale = InputScale(frames=10, maximum=40)
    counts = np.array([[0, 1], [4, 7]])
    one, ten = (
        value_per_event(DqnSnnParameters.from_mapping({'encoding.frames': frames}), scale)
        for frames in (1, 10)
    )
    assert (one, ten) == (0.25, pytest.approx(0.025))
    assert input_values(counts, one).tolist() == [0.0, 0.25, 1.0, 1.0]
    assert input_values(counts, ten).tolist() == pytest.approx([0, 0.025, 0.1, 0.175])


def test_the_scale_holds_for_frames_of_another_length() -> None:
    """40 in 100 ms are 4 in 10 ms, whether the frames have 10 ms or 50."""
    scale = InputScale(frames=10, maximum=40, frame_ms=10)
    for frames, frame_ms, expected in ((1, 10, 0.25), (2, 50, 0.025), (10, 10, 0.025)):
        values = {'encoding.frames': frames, 'encoding.frame_ms': frame_ms}
        parameters = DqnSnnParameters.from_mapping(values)
        assert value_per_event(parameters, scale) == pytest.approx(expected)


def test_counts_can_be_taken_without_a_scale() -> None:
    """As the authors' driver does: an input with an event then fires in every time step."""
    scale = InputScale(frames=10, maximum=40)
    assert value_per_event(DqnSnnParameters(event_value=1.0), scale) == 1.0
    assert input_values(np.array([[0, 1], [4, 7]]), 1.0).tolist() == [0.0, 1.0, 1.0, 1.0]


def test_it_drives_towards_the_most_spikes(tmp_path: Path) -> None:
    """Its traces decay to 0.8 in a step, and the largest decides at each one."""
    controller = DqnSnn(DqnSnnParameters(checkpoint=save(tmp_path, by_sides())))
    right, left = events_at((100, 60)), events_at((10, 60))
    nothing = Observation(PERIOD_NS, no_events(), None)
    # One event is a value of 1: a spike in each of 10 time steps; 30 of them have 3 eighths.
    expected = [
        (right, (0, 1, 10), (0, 1, 10), (1.25, 0.75)),
        (left, (10, 1, 0), (10, 1.8, 8), (0.75, 1.25)),
        (nothing, (0, 1, 0), (8, 2.44, 6.4), (0.75, 1.25)),
    ]
    for seen, spikes, traces, wheels in expected:
        assert controller.step(seen) == wheels
        assert controller.spikes == spikes
        assert controller.traces.tolist() == pytest.approx(traces)
    for _ in range(12):
        controller.step(nothing)
    assert controller.neurons[controller.action] == 'straight'
    assert controller.step(nothing) == (1.0, 1.0)


def test_without_a_spike_the_first_action_is_chosen(tmp_path: Path) -> None:
    """All traces are equal then."""
    silent = by_sides()._replace(hidden_bias=np.zeros(3, np.float32))
    controller = DqnSnn(DqnSnnParameters(checkpoint=save(tmp_path, silent)))
    assert controller.action == -1
    assert controller.step(Observation(PERIOD_NS, no_events(), None)) == (0.75, 1.25)
    assert (controller.spikes, controller.action) == ((0, 0, 0), 0)


def test_an_episode_begins_at_rest_and_a_seed_gives_the_same_bits(random_network: str) -> None:
    """Potentials live on from step to step, but not from episode to episode."""

    def drive(controller: DqnSnn, seed: int) -> list[object]:
        controller.reset(np.random.default_rng(seed))
        events = np.random.default_rng(7)
        answers: list[object] = []
        for _ in range(40):
            pixels = zip(events.integers(0, 128, 60), events.integers(40, 104, 60), strict=True)
            wheels = controller.step(events_at(*pixels))
            answers.append((wheels, controller.spikes, controller.traces.tobytes()))
        return answers

    parameters = DqnSnnParameters(checkpoint=random_network)
    controller = DqnSnn(parameters)
    first = drive(controller, 1)
    assert drive(controller, 1) == first
    assert drive(DqnSnn(parameters), 1) == first
    assert drive(controller, 2) != first


def test_what_is_shipped_is_the_spiking_network_alone(random_network: str, tmp_path: Path) -> None:
    """With the command that made it."""
    file = tmp_path / 'shipped.safetensors'
    export_transferred(Path(random_network), file, 'spikelane transfer')
    arrays, facts = read_checkpoint(file, 'dqn_snn')
    assert set(arrays) == {f'network.{name}' for name in FeedForward._fields}
    assert facts['command'] == 'spikelane transfer'
    assert facts['config'] == {'seed': 0, 'checkpoint': 'dqn'}
    one, other = (read_transferred(str(each), INPUTS, 3) for each in (random_network, file))
    assert one.scale == other.scale
    assert all((a == b).all() for a, b in zip(one.network, other.network, strict=True))


def test_networks_are_shipped() -> None:
    """Each is small, and the file says by which command it was made."""
    assert 'scenario_1' in shipped_weights('dqn_snn')
    assert shipped_weights('dqn') == ('scenario_1', 'scenario_2', 'scenario_3')
    folder = Path(__file__).parents[4] / 'controllers/spikelane_controllers/dqn_snn/weights'
    for name in shipped_weights('dqn_snn'):
        file = folder / f'{name}.safetensors'
        assert file.stat().st_size < 500_000
        assert read_transferred(name, INPUTS, 3).scale.frames == 10
        command = read_checkpoint(file, 'dqn_snn').facts['command']
        assert command.startswith('spikelane transfer --checkpoint ')


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('hidden_weights', np.zeros((3, 500)), r'network.hidden_weights: .* shape \(3, 500\)'),
        ('hidden_bias', np.zeros(4), r'network.hidden_weights: expected shape \(4, 512\)'),
        ('output_weights', np.zeros((2, 3)), r'expected shape \(3, 3\), got shape \(2, 3\)'),
        ('hidden_bias', np.array([0, np.nan, 0]), 'expected finite numbers, got NaN'),
        (
            'hidden_weights',
            np.full((3, 512), 0.5),
            'expected normalised weights, got a sum of 256',
        ),
        ('hidden_weights', None, 'network.hidden_weights: expected in the state, but it is miss'),
    ],
)
def test_other_networks_are_refused(
    tmp_path: Path, name: str, value: np.ndarray | None, message: str
) -> None:
    """In one line that names the file and the array."""
    zeros = single(np.zeros((3, INPUTS)), np.zeros(3), np.zeros((3, 3)))
    file = Path(save(tmp_path, zeros))
    arrays, facts = read_checkpoint(file, 'dqn_snn')
    if value is None:
        del arrays[f'network.{name}']
    else:
        arrays[f'network.{name}'] = value.astype(np.float32)
    write_checkpoint(file, 'dqn_snn', arrays, facts)
    with pytest.raises(CheckpointError, match=message) as caught:
        DqnSnn(DqnSnnParameters(checkpoint=str(file)))
    assert str(caught.value).startswith(f'{file}: ')
    assert '\n' not in str(caught.value)


def test_other_files_are_refused(random_network: str, tmp_path: Path) -> None:
    """Truncated, foreign, of another controller, without a scale, not there."""
    content, file = Path(random_network).read_bytes(), tmp_path / 'x.safetensors'
    cases = []
    file.write_bytes(content[:-1])
    cases.append(('expected a whole safetensors file', file))
    foreign = tmp_path / 'foreign.safetensors'
    save_file(load_file(random_network), foreign)
    cases.append(('expected a checkpoint of Spikelane', foreign))
    other = tmp_path / 'other.safetensors'
    write_checkpoint(other, 'dqn', {}, {})
    cases.append(('expected controller dqn_snn, got dqn', other))
    unscaled = tmp_path / 'unscaled.safetensors'
    arrays, facts = read_checkpoint(Path(random_network), 'dqn_snn')
    write_checkpoint(unscaled, 'dqn_snn', arrays, {**facts, 'maximum': 0})
    cases.append(('maximum: expected a whole number of at least 1, got 0', unscaled))
    cases.append(("expected one of .* got '", tmp_path / 'none'))
    for message, path in cases:
        with pytest.raises(CheckpointError, match=message):
            DqnSnn(DqnSnnParameters(checkpoint=str(path)))


def test_neurons_are_simulated_for_a_fifth_of_each_period() -> None:
    """10 ms of 50 ms are 2 of 10 ms; 7 ms have no whole number of time steps."""
    steps = [DqnSnnParameters(period_ms=each).step_neurons.steps for each in (50, 20, 10, 5)]
    assert steps == [10, 4, 2, 1]
    with pytest.raises(ParameterError, match='simulated_ms: expected a multiple of step_ms'):
        DqnSnnParameters(period_ms=7)


def test_the_file_of_parameters_holds_every_default() -> None:
    """The YAML file and the dataclasses agree in both directions."""
    values = yaml.safe_load(CONFIG.read_text())['/**']['ros__parameters']
    assert DqnSnnParameters.from_mapping(values) == DqnSnnParameters()
    named = set()
    for name, value in values.items():
        named |= {f'{name}.{key}' for key in value} if isinstance(value, dict) else {name}
    assert named == {spec.name for spec in DqnSnnParameters.specs()}
