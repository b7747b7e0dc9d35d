"""The NIR graph, read back and run by Norse: the same spikes for the same spikes."""

from __future__ import annotations

import importlib.util
import itertools
from pathlib import Path
import re
import sys
from typing import Any

import numpy as np
import pytest

from spikelane.runs.configuration import Request
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.run import drive_lap
from spikelane_controllers.dqn_snn.controller import (
    DqnSnn,
    DqnSnnParameters,
    input_values,
)
from spikelane_controllers.dqn_snn.feedforward import FeedForward
from spikelane_controllers.dqn_snn.integrate_and_fire import (
    input_spikes,
    IntegrateAndFire,
    resting_potentials,
)
from spikelane_controllers.dqn_snn.nir_export import export_nir, NirExportError
from spikelane_controllers.dqn_snn.normalisation import normalise
from spikelane_controllers.dqn_snn.transferred import (
    InputScale,
    Transferred,
    write_transferred,
)
from spikelane_controllers.spiking.spikes import SPIKE_DTYPE
from spikelane_sim.contract import WheelVelocities
from spikelane_sim.encoding import StateImage
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

READER = Path(__file__).with_name('nir_reader.py')
INPUTS, HIDDEN, STEPS = 512, 50, 400


def drawn_network(seed: int) -> FeedForward:
    """Draw a normalised network that is excited a little more than it is inhibited."""
    rng = np.random.default_rng(seed)
    return normalise(
        FeedForward(
            rng.normal(0.1, 1, (HIDDEN, INPUTS)).astype(np.float32),
            rng.normal(0, 1, HIDDEN).astype(np.float32),
            rng.normal(0.1, 1, (3, HIDDEN)).astype(np.float32),
        )
    ).network


def exported(folder: Path, network: FeedForward, **values: Any) -> tuple[Any, DqnSnnParameters]:
    """Export a network and read the graph back."""
    import nir

    checkpoint = folder / 'network.safetensors'
    write_transferred(checkpoint, network, Transferred(network, InputScale(10, 40)), {})
    parameters = DqnSnnParameters.from_mapping({'checkpoint': str(checkpoint), **values})
    export_nir(folder / 'network.nir', parameters)
    return nir.read(folder / 'network.nir'), parameters


def norse_spikes(graph: Any, inputs: np.ndarray, v_min: float | None) -> np.ndarray:
    """Run a graph in Norse, which knows nothing of a lowest potential, and raise them to v_min."""
    from norse.torch import from_nir
    import torch

    network, state, outputs = from_nir(graph, dt=graph.metadata['dt']), None, []
    with torch.no_grad():
        for row in inputs:
            spikes, state = network(torch.from_numpy(row[None].astype(np.float32)), state)
            outputs.append(spikes[0].numpy().astype(int))
            if v_min is not None:
                for name, (neurons,) in state.state.items():
                    state.state[name] = (neurons._replace(v=neurons.v.clamp(min=v_min)),)
    return np.array(outputs)


def our_spikes(
    network: FeedForward, inputs: np.ndarray, parameters: DqnSnnParameters
) -> np.ndarray:
    """Run the network here."""
    steps, sources = np.nonzero(inputs)
    spikes = np.empty(len(steps), SPIKE_DTYPE)
    spikes['step'], spikes['source'] = steps, sources
    simulated = IntegrateAndFire(network, parameters.neurons)
    return simulated.run(resting_potentials(network), spikes, len(inputs))[1].output


def input_raster(seed: int) -> np.ndarray:
    """Draw input spikes, (STEPS, INPUTS)."""
    return np.random.default_rng(seed).random((STEPS, INPUTS)) < 0.3


def test_a_graph_is_read_back_as_it_was(tmp_path: Path) -> None:
    """Affine, IF, Affine, IF in a row, with the weights and what is around them."""
    network = drawn_network(0)
    graph, _ = exported(tmp_path, network)
    names = ['input', 'to_hidden', 'hidden', 'to_output', 'action', 'output']
    assert sorted(graph.edges) == sorted(itertools.pairwise(names))
    kinds = [type(graph.nodes[name]).__name__ for name in names]
    assert kinds == ['Input', 'Affine', 'IF', 'Affine', 'IF', 'Output']
    assert (graph.nodes['to_hidden'].weight == network.hidden_weights).all()
    assert (graph.nodes['to_hidden'].bias == network.hidden_bias).all()
    assert (graph.nodes['to_output'].weight == network.output_weights).all()
    assert not graph.nodes['to_output'].bias.any()
    for name, number in (('hidden', HIDDEN), ('action', 3)):
        neurons = graph.nodes[name]
        assert neurons.v_threshold.tolist() == [1 - 2**-21] * number
        assert neurons.v_reset.tolist() == [0.0] * number
        assert neurons.r.tolist() == [1.0] * number
    expected = {
        'dt': 0.001,
        'time_steps_per_observation': 10,
        'scale_frames': 10,
        'scale_frame_s': 0.05,
        'scale_maximum': 40,
        'v_min': 0.0,
        'trace_decay': 0.8,
    }
    assert {name: graph.metadata[name] for name in expected} == expected


@pytest.mark.parametrize('seed', range(3))
def test_norse_fires_the_same_spikes(tmp_path: Path, seed: int) -> None:
    """Exactly as NIR has it, without a lowest potential."""
    network = drawn_network(seed)
    graph, parameters = exported(tmp_path, network, **{'neurons.clamped': False})
    assert 'v_min' not in graph.metadata
    inputs = input_raster(seed)
    ours = our_spikes(network, inputs, parameters)
    assert ours.sum() > 5
    assert (norse_spikes(graph, inputs, None) == ours).all()


@pytest.mark.parametrize('seed', range(3))
def test_norse_with_a_lowest_potential_fires_as_the_controller(tmp_path: Path, seed: int) -> None:
    """Whoever raises potentials to v_min after each time step; without, it makes a difference."""
    network = drawn_network(seed)
    graph, parameters = exported(tmp_path, network)
    inputs = input_raster(seed)
    ours = our_spikes(network, inputs, parameters)
    assert ours.sum() > 5
    assert (norse_spikes(graph, inputs, float(graph.metadata['v_min'])) == ours).all()
    assert (norse_spikes(graph, inputs, None) != ours).any()


def test_norse_fires_as_the_shipped_network_does_on_the_road(tmp_path: Path) -> None:
    """100 steps of 50 ms, the events of which make 1,000 time steps of input spikes."""
    import nir

    export_nir(tmp_path / 'lane.nir', DqnSnnParameters())
    graph = nir.read(tmp_path / 'lane.nir')
    parameters = {'robot.model': 'kinematic'}
    controller, rng, rows, ours = DqnSnn(), np.random.default_rng(1), [], []
    image = StateImage(controller.parameters.encoding)
    controller.reset(np.random.default_rng(1))  # the same numbers as rng
    with Simulator(SimulatorParameters.from_mapping(parameters)) as simulator:
        observation = simulator.reset('outer', 1)
        for _ in range(100):
            image.add(observation.events)
            values = input_values(image.counts, graph.metadata['input_value_per_event'])
            raster = np.zeros((graph.metadata['time_steps_per_observation'], INPUTS), bool)
            drawn = input_spikes(values, controller.parameters.neurons, rng)
            raster[drawn['step'], drawn['source']] = True
            rows.append(raster)
            observation = simulator.step(controller.step(observation))
            ours.append(controller.spikes)
    theirs = norse_spikes(graph, np.vstack(rows), float(graph.metadata['v_min']))
    assert sum(map(sum, ours)) > 3
    assert theirs.reshape(100, 10, 3).sum(axis=1).tolist() == [list(each) for each in ours]


def reader(path: Path, generator: np.random.Generator) -> Any:
    """Read a file by the reader that was written from the page."""
    spec = importlib.util.spec_from_file_location('nir_reader', READER)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.Reader(path, generator)


@pytest.mark.parametrize(
    ('lane', 'values'),
    [
        ('outer', {}),
        ('inner', {'encoding.frames': 3, 'trace_decay': 0.7, 'actions.turn_rad_s': 0.3}),
    ],
)
def test_a_reader_written_from_the_page_drives_the_same_lap(
    tmp_path: Path, lane: str, values: dict[str, Any]
) -> None:
    """A whole lap of scenario 1, of which every answer is that of the controller, bit for bit."""
    export_nir(tmp_path / 'lane.nir', DqnSnnParameters.from_mapping(values))
    parameters = {
        'simulator.robot.model': 'kinematic',
        **{f'dqn_snn.{name}': value for name, value in values.items()},
    }
    config = LapConfig.make(Request('1', 'dqn_snn', 4, 'inprocess', parameters), lane)
    ours = drive_lap(config, lambda *_: None).trajectory
    theirs = reader(tmp_path / 'lane.nir', np.random.default_rng([4, 1, 1]))
    distances = []
    with Simulator(SimulatorParameters.from_mapping({'robot.model': 'kinematic'})) as simulator:
        observation = simulator.reset(lane, 4)
        while True:
            distances.append(observation.lane.distance_m)
            wheels = theirs.answer(observation.events['x'], observation.events['y'])
            if observation.lane.terminated:
                break
            observation = simulator.step(WheelVelocities(*wheels))
    assert observation.lane.laps == 1
    assert len(distances) > 5000
    assert distances == ours.distance_m.tolist()


def test_the_reader_needs_nothing_of_spikelane() -> None:
    """It imports NIR and NumPy alone."""
    source = READER.read_text('utf-8')
    imported = re.findall(r'^(?:import|from) (\w+)', source, re.M)
    assert set(imported) == {'__future__', 'pathlib', 'typing', 'nir', 'numpy'}


def test_the_page_describes_every_entry_of_the_metadata(tmp_path: Path) -> None:
    """And no other ones."""
    page = (Path(__file__).parents[4] / 'docs/nir.md').read_text('utf-8')
    table = page[page.index('## The metadata') : page.index('## The controller, step by step')]
    rows = re.findall(r'^\| (`.+?) \|', table, re.M)
    described = {name for row in rows for name in re.findall(r'`(\w+)`', row)}
    graph, _ = exported(tmp_path, drawn_network(0))
    assert described == set(graph.metadata)


def test_the_metadata_has_what_is_around_the_network(tmp_path: Path) -> None:
    """From the sensor to the wheels, with the paper's values."""
    graph, _ = exported(tmp_path, drawn_network(0))
    expected = {
        'format_version': 1,
        'sensor_width_px': 128,
        'sensor_height_px': 128,
        'crop_top_px': 40,
        'crop_bottom_px': 24,
        'cell_px': 4,
        'input_rows': 16,
        'input_columns': 32,
        'observation_period_s': 0.05,
        'input_frames': 1,
        'input_value_per_event': 0.25,
        'input_spike_probability': 1.0,
        'initial_potential': 0.0,
        'initial_trace': 0.0,
    }
    assert {name: graph.metadata[name] for name in expected} == expected
    assert graph.metadata['action_left_wheel_rad_s'].tolist() == [0.75, 1.0, 1.25]
    assert graph.metadata['action_right_wheel_rad_s'].tolist() == [1.25, 1.0, 0.75]


def test_where_nothing_inhibits_the_lowest_potential_makes_no_difference(tmp_path: Path) -> None:
    """Then NIR's graph is the controller's network as it stands."""
    network = drawn_network(4)
    excited = normalise(FeedForward(*(np.maximum(each, 0) for each in network))).network
    graph, parameters = exported(tmp_path, excited)
    ours = our_spikes(excited, input_raster(4), parameters)
    assert ours.sum() > 20
    assert (norse_spikes(graph, input_raster(4), None) == ours).all()


def test_firing_at_and_above_the_threshold_are_the_same(tmp_path: Path) -> None:
    """Norse fires above: four inputs of a quarter reach it exactly."""
    quarter = np.zeros((1, INPUTS), np.float32)
    quarter[0, :4] = 0.25
    network = FeedForward(quarter, np.zeros(1, np.float32), np.eye(3, 1, dtype=np.float32))
    graph, parameters = exported(tmp_path, network)
    inputs = np.zeros((5, INPUTS), bool)
    inputs[1:4, :4] = [[1, 1, 1, 1], [1, 1, 1, 0], [0, 0, 0, 1]]
    expected = [[0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0]]
    assert our_spikes(network, inputs, parameters).tolist() == expected
    assert norse_spikes(graph, inputs, None).tolist() == expected


def test_what_nir_lacks_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reset by subtraction; and NIR itself may not be there."""
    with pytest.raises(NirExportError, match=r'neurons.reset: expected zero, .* got subtract'):
        exported(tmp_path, drawn_network(0), **{'neurons.reset': 'subtract'})
    monkeypatch.setitem(sys.modules, 'nir', None)
    checkpoint = str(tmp_path / 'network.safetensors')
    with pytest.raises(NirExportError, match=r"found none: pip install 'spikelane\[nir\]'$"):
        export_nir(tmp_path / 'x.nir', DqnSnnParameters(checkpoint=checkpoint))
    assert not (tmp_path / 'x.nir').exists()
