"""The spiking network as a NIR graph (Neuromorphic Intermediate Representation), to run elsewhere.

Input -> Affine -> IF -> Affine -> IF -> Output, with R = 1 and a time step in which the weights of
all spikes are added to the potential: that is how NIR's simulators read an IF node.

Two things need care:

- NIR has a neuron fire above its threshold, we at it, and simulators do either. The weights are
  multiples of GRID and so are the potentials; the threshold is put half a GRID lower, where no
  potential can be, and then both are the same.
- **NIR has no word for potentials that never fall below 0.** The graph's metadata has
  `v_min` = 0 where it is so. A simulator that knows nothing of it lets potentials sink, and
  neurons that are mostly inhibited then hardly ever fire; it has to raise potentials to `v_min`
  after each time step. Networks run with `neurons.clamped` false are exported as they are.

What is around the network is in the metadata alone, from the sensor's pixels to the wheels'
velocities: `docs/nir.md` describes every entry, so that the controller can be built from the file
without this package. A change of an entry also changes that page and FORMAT_VERSION.
"""

from __future__ import annotations

import io
import itertools
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from spikelane_controllers.dqn_snn.controller import DqnSnnParameters, value_per_event
from spikelane_controllers.dqn_snn.integrate_and_fire import IntegrateAndFireParameters
from spikelane_controllers.dqn_snn.normalisation import GRID
from spikelane_controllers.dqn_snn.transferred import (
    InputScale,
    read_transferred,
    Transferred,
)
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import write_bytes_atomically
from spikelane_sim.task import action_wheels, ACTIONS

if TYPE_CHECKING:
    import nir

#: Version of the metadata, as `docs/nir.md` describes it.
FORMAT_VERSION = 1


class NirExportError(SpikelaneError):
    """The network has no NIR graph, or NIR is not installed."""

    exit_status = 1


def nir_graph(transferred: Transferred, parameters: DqnSnnParameters) -> nir.NIRGraph:
    """Return the network as a graph.

    Raises:
        NirExportError: Neurons are reset by subtraction, or NIR is not installed.
    """
    nir = _import_nir()
    neurons = parameters.neurons
    if neurons.reset != 'zero':
        raise NirExportError(
            f"neurons.reset: expected zero, since NIR's IF neuron has no other, "
            f'got {neurons.reset}'
        )
    network = transferred.network
    hidden, inputs = network.hidden_weights.shape
    outputs = len(network.output_weights)
    names = ('input', 'to_hidden', 'hidden', 'to_output', 'action', 'output')
    nodes = (
        nir.Input({'input': np.array([inputs])}),
        nir.Affine(network.hidden_weights, network.hidden_bias),
        _neurons(nir, hidden, neurons.threshold_mv),
        # A bias of 0 rather than a Linear node, which not all simulators read.
        nir.Affine(network.output_weights, np.zeros(outputs, np.float32)),
        _neurons(nir, outputs, neurons.threshold_mv),
        nir.Output({'output': np.array([outputs])}),
    )
    return nir.NIRGraph(
        nodes=dict(zip(names, nodes, strict=True)),
        edges=list(itertools.pairwise(names)),
        metadata=_metadata(transferred, parameters),
    )


def export_nir(path: Path, parameters: DqnSnnParameters) -> nir.NIRGraph:
    """Write the network of a controller as a NIR graph.

    Args:
        path: File to write; `nir.read` reads it.
        parameters: Parameters of the controller.

    Raises:
        CheckpointError: The controller's network cannot be read.
        NirExportError: As in `nir_graph`.
        FileError: The file cannot be written.
    """
    encoding = parameters.encoding
    inputs = encoding.rows * encoding.columns
    transferred = read_transferred(parameters.checkpoint, inputs, len(ACTIONS))
    graph = nir_graph(transferred, parameters)
    content = io.BytesIO()
    _import_nir().write(content, graph)
    write_bytes_atomically(path, content.getvalue())
    return graph


def _neurons(nir: Any, number: int, threshold: float) -> nir.IF:
    """Return neurons whose threshold lies between two multiples of GRID."""
    between = (math.ceil(threshold / GRID) - 0.5) * GRID
    ones = np.ones(number, np.float32)
    return nir.IF(r=ones, v_threshold=between * ones, v_reset=0 * ones)


def _metadata(transferred: Transferred, parameters: DqnSnnParameters) -> dict[str, Any]:
    metadata = {
        'format': 'spikelane.dqn_snn',
        'format_version': FORMAT_VERSION,
        'description': 'Spikelane DQN-SNN: Poisson inputs, one output neuron for each action',
        **_inputs(transferred.scale, parameters),
        **_time(parameters.step_neurons, parameters.period_s),
        **_decision(parameters),
    }
    return metadata | ({'v_min': 0.0} if parameters.neurons.clamped else {})


def _inputs(scale: InputScale, parameters: DqnSnnParameters) -> dict[str, Any]:
    """Describe how events become the values of the inputs."""
    encoding = parameters.encoding
    return {
        'sensor_width_px': encoding.width,
        'sensor_height_px': encoding.height,
        'crop_top_px': encoding.crop_top,
        'crop_bottom_px': encoding.crop_bottom,
        'cell_px': encoding.cell,
        'input_rows': encoding.rows,
        'input_columns': encoding.columns,
        'input_order': 'rows from the top, in each row columns from the left',
        'input_frames': parameters.steps_of(encoding.frames, encoding.frame_ms),
        'input_value_per_event': value_per_event(parameters, scale),
        'scale_frames': scale.frames,
        'scale_frame_s': scale.frame_ms / 1000,
        'scale_maximum': scale.maximum,
    }


def _time(neurons: IntegrateAndFireParameters, period_s: float) -> dict[str, Any]:
    """Describe what happens in a time step."""
    return {
        'observation_period_s': period_s,
        'dt': neurons.step_ms / 1000,
        'time_steps_per_observation': neurons.steps,
        'input_max_rate_hz': neurons.max_rate_hz,
        'input_spike_probability': neurons.probability,
        'potential_update': 'weights of spikes and bias are added once in a time step',
        'layer_order': 'a spike reaches the next layer in the same time step',
        'initial_potential': 0.0,
    }


def _decision(parameters: DqnSnnParameters) -> dict[str, Any]:
    """Describe how spikes become wheel velocities."""
    wheels = [action_wheels(action, parameters.actions) for action in range(len(ACTIONS))]
    return {
        'actions': ' '.join(ACTIONS),
        'initial_trace': 0.0,
        'trace_decay': parameters.trace_decay**parameters.share,
        'decision_rule': 'the largest trace, the first of equal ones',
        'action_left_wheel_rad_s': [each.left for each in wheels],
        'action_right_wheel_rad_s': [each.right for each in wheels],
    }


def _import_nir() -> Any:
    try:
        import nir
    except ImportError:
        raise NirExportError(
            "nir: expected the Python package, found none: pip install 'spikelane[nir]'"
        ) from None
    return nir
