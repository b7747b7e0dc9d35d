"""Recordings of controllers: other programs read them, and they hold what happened."""

from __future__ import annotations

from collections.abc import Iterator
import json
from pathlib import Path
import signal
import tracemalloc
from typing import Any

import neo
import numpy as np
from numpy.typing import NDArray
import pytest
import quantities as pq
import xarray as xr

import spikelane
from spikelane.finished import RunError
from spikelane.interruption import Interrupted
from spikelane.loop import drive_episode
from spikelane.main import run
from spikelane.recording.figure import draw_recording
from spikelane.recording.file import RecordingFile
from spikelane.recording.record import written
from spikelane_controllers.quantities import Axis, begin_to_record, Quantity, SpikeTimes
from spikelane_controllers.shown import shown_by
from spikelane_sim.contract import Observation, WheelVelocities
from spikelane_sim.errors import ParameterError, SpikelaneError
from spikelane_sim.files import FileError
from spikelane_sim.period import PERIOD_NS
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

STEPS = 300
SHORT = {'simulator.episode.max_steps': STEPS}


@pytest.fixture(scope='module')
def lap(tmp_path_factory: pytest.TempPathFactory) -> spikelane.Run:
    """Give 300 steps of R-STDP with everything recorded."""
    return spikelane.drive(
        'rstdp',
        engine='kinematic',
        seed=1,
        parameters=SHORT,
        record=['all'],
        out=tmp_path_factory.mktemp('runs') / 'lap',
    )


@pytest.fixture
def dataset(lap: spikelane.Run) -> Iterator[xr.Dataset]:
    """Give it as xarray reads it."""
    with xr.open_dataset(lap.recording) as found:
        yield found


def test_xarray_reads_what_the_controller_recorded(dataset: xr.Dataset) -> None:
    """Every number of a drive that was watched step by step."""
    values = {'episode.max_steps': STEPS, 'robot.engine': 'kinematic'}
    controller: Any = spikelane.make_controller('rstdp', checkpoint='scenario_1')
    begin_to_record('rstdp', controller, ['all'])
    seen: list[tuple[int, Any]] = []

    def on_step(observation: Observation, wheels: WheelVelocities) -> None:
        seen.append((observation.stamp_ns, shown_by(controller).recorded))

    with Simulator(SimulatorParameters.from_mapping(values)) as simulator:
        drive_episode(simulator, controller, on_step, lane='outer', seed=1, controller_seed=1)
    assert dataset['stamp_ns'].values.tolist() == [stamp_ns for stamp_ns, _ in seen]
    assert dataset['episode_step'].values.tolist() == list(range(STEPS + 1))
    for name in ('weights', 'traces', 'dopamine', 'potentials'):
        expected = np.concatenate([recorded[name] for _, recorded in seen])
        assert np.array_equal(dataset[name].values, expected)
    for name, source in (('spikes', 'neuron'), ('input_spikes', 'input')):
        spikes: list[SpikeTimes] = [recorded[name] for _, recorded in seen]
        sources = np.concatenate([each.sources for each in spikes])
        assert np.array_equal(dataset[f'{name}_{source}'].values, sources)
    first = seen[0][1]['potentials']
    assert first.shape == (50, 2)
    assert dataset['potentials_time_ns'].values[:2].tolist() == [1_000_000, 2_000_000]


def test_xarray_gives_names_units_and_where_it_came_from(dataset: xr.Dataset) -> None:
    """Literals."""
    assert dict(dataset['weights'].sizes) == {'step': STEPS + 1, 'neuron': 2, 'input': 32}
    assert dataset['neuron'].values.tolist() == ['left', 'right']
    assert dataset['input'].values.tolist()[:9] == [*(f'0,{k}' for k in range(8)), '1,0']
    assert dataset['weights'].attrs['units'] == 'pA'
    assert dataset['potentials'].attrs['units'] == 'mV'
    assert dataset['dopamine'].attrs['units'] == '1/ms'
    facts = {name: dataset.attrs[name] for name in ('controller', 'scenario', 'seed', 'complete')}
    assert facts == {'controller': 'rstdp', 'scenario': '1', 'seed': 1, 'complete': 1}
    right = dataset['weights'].sel(neuron='right', input='3,0')
    assert right.shape == (STEPS + 1,)


def test_neo_takes_the_spikes_and_potentials(lap: spikelane.Run, dataset: xr.Dataset) -> None:
    """As the docs do it; spikes are those counted, and each resets the potential for 2 ms."""
    end = float(dataset['stamp_ns'][-1]) * 1e-9 * pq.s
    times = dataset['spikes_time_ns'].values
    trains = [
        neo.SpikeTrain(times[dataset['spikes_neuron'] == index] * 1e-9, units='s', t_stop=end)
        for index in range(2)
    ]
    counts = lap.spikes.groupby('neuron', observed=True)['spikes'].sum()
    assert [len(each) for each in trains] == [counts['left'], counts['right']]
    assert min(map(len, trains)) > 300
    signal_mv = neo.AnalogSignal(
        dataset['potentials'].values, units='mV', sampling_period=1 * pq.ms, t_start=1 * pq.ms
    )
    assert signal_mv.t_stop.rescale('s').magnitude == pytest.approx(float(end), abs=0.0011)
    assert float(signal_mv.max()) < -55.0
    assert float(signal_mv.min()) == -70.0
    for index, train in enumerate(trains):
        after = np.ceil(train.rescale('ms').magnitude - 1e-6).astype(int) - 1
        for sample in (after, np.minimum(after + 1, len(signal_mv) - 1)):
            assert set(signal_mv.magnitude[sample, index].tolist()) == {-70.0}


def test_pandas_gives_a_row_for_each_value(lap: spikelane.Run) -> None:
    """In the order of time; the weights do not change, as the drive does not learn."""
    weights = lap.recorded('weights')
    assert list(weights.columns) == ['time_ns', 'neuron', 'input', 'value']
    assert len(weights) == (STEPS + 1) * 2 * 32
    last = weights[weights['time_ns'] == weights['time_ns'].max()]
    assert np.array_equal(last['value'], lap.weights['weight'])
    assert last['input'].tolist()[:2] == ['0,0', '0,1']
    spikes = lap.recorded('spikes')
    assert list(spikes.columns) == ['time_ns', 'neuron']
    assert spikes['time_ns'].is_monotonic_increasing
    per_step = spikes.groupby((spikes['time_ns'] - 1) // PERIOD_NS)['neuron'].count()
    counted = lap.spikes.groupby('stamp_ns')['spikes'].sum()
    assert per_step.tolist() == counted[counted > 0].tolist()
    dopamine = lap.recorded('dopamine')
    assert dopamine['time_ns'].tolist()[:2] == [0, 0]
    with pytest.raises(RunError, match=r'expected one of spikes, .*, weights, got rates'):
        lap.recorded('rates')


def test_a_lap_is_the_same_with_a_recording(lap: spikelane.Run) -> None:
    """And a run without a folder has its recording as well, while the run is there."""
    plain = spikelane.drive('rstdp', engine='kinematic', seed=1, parameters=SHORT)
    assert plain.trajectory.equals(lap.trajectory)
    assert plain.spikes.equals(lap.spikes)
    with pytest.raises(RunError, match=r'expected recording\.nc, which'):
        plain.recorded('spikes')
    kept = spikelane.drive(
        'rstdp', engine='kinematic', seed=1, parameters=SHORT, record=['traces', 'spikes']
    )
    assert kept.recorded('traces').equals(lap.recorded('traces'))
    with pytest.raises(RunError, match='expected one of spikes, traces, got weights'):
        kept.recorded('weights')
    file = kept.recording
    assert file.exists()
    del kept
    assert not file.exists()


def test_a_recording_is_drawn(lap: spikelane.Run, tmp_path: Path) -> None:
    """With every lap that has one; without steps there is nothing to draw."""
    assert lap.folder is not None
    assert (lap.folder / 'figures/recording.png').read_bytes().endswith(b'IEND\xaeB`\x82')
    with written(tmp_path / 'empty.nc', [VALUES], {}):
        pass
    with pytest.raises(SpikelaneError, match=r'empty\.nc: expected at least one step, got none'):
        draw_recording(tmp_path / 'empty.nc', tmp_path / 'figure.png')
    [drawn] = draw_recording(lap.recording, tmp_path / 'figure.svg', 'a lap')
    # A line each for the spikes drawn of one second, and more.
    assert drawn.read_text().count('<path') > 100


def test_an_object_of_ones_own_is_recorded() -> None:
    """By the name of its class; one that offers nothing is refused."""
    braitenberg = spikelane.make_controller('braitenberg')
    parameters = {'simulator.episode.max_steps': 40}
    lap = spikelane.drive(
        braitenberg, engine='kinematic', parameters=parameters, record=['potentials']
    )
    assert len(lap.recorded('potentials')) == 41 * 50 * 2

    class Silent:
        def reset(self, rng: np.random.Generator) -> None:
            pass

        def step(self, observation: Observation) -> WheelVelocities:
            return WheelVelocities(1.0, 1.0)

    with pytest.raises(ParameterError, match='expected nothing, which Silent offers, got spikes'):
        spikelane.drive(Silent(), parameters=parameters, record=['spikes'])


def test_a_training_is_the_same_with_a_recording(tmp_path: Path) -> None:
    """Its checkpoint has the same bytes, and the recording the weights of every step."""
    training, plain = (
        spikelane.train(
            'rstdp', engine='kinematic', seed=1, steps=1500, record=record, out=tmp_path / name
        )
        for name, record in (('a', ['weights', 'dopamine']), ('b', []))
    )
    files = [tmp_path / name / 'checkpoint.safetensors' for name in 'ab']
    assert files[0].read_bytes() == files[1].read_bytes()
    assert training.weights.equals(plain.weights)
    with xr.open_dataset(training.recording) as found:
        last = found['weights'].values[-1].ravel()
        assert np.array_equal(last, training.weights['weight'])
        assert np.abs(np.diff(found['weights'], axis=0)).max() > 0
        assert len(np.unique(found['episode'])) == training.episodes['episode'].max() + 1
    assert json.loads((tmp_path / 'a/metrics.json').read_text())['recording'].endswith(
        'a/recording.nc'
    )


def test_each_lap_of_an_evaluation_has_its_recording(tmp_path: Path) -> None:
    """In its own folder."""
    out = tmp_path / 'out'
    spikelane.evaluate(
        'braitenberg',
        engine='kinematic',
        parameters={'simulator.episode.max_steps': 20},
        record=['spikes'],
        out=out,
    )
    found = sorted(str(each.relative_to(out)) for each in out.rglob('*.nc'))
    assert found == [f'laps/{lane}-seed0/recording.nc' for lane in ('inner', 'outer')]


@pytest.mark.parametrize(
    ('words', 'message'),
    [
        (
            'lap --controller braitenberg --record traces',
            'record: expected any of spikes, input_spikes, potentials, or all, which braitenberg '
            'offers, got traces',
        ),
        ('evaluate --controller dqn --record spikes', 'expected nothing, which dqn offers'),
        ('train rstdp --record spikes,', "expected names with commas between them, got 'spikes,'"),
        ('train rstdp --record all --resume', 'expected a training that begins'),
        ('train rstdp --record all --transport ros', 'expected a training in this process'),
    ],
)
def test_what_cannot_be_recorded_is_refused_before_anything_is_made(
    words: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With exit status 2, in one line."""
    assert run([*words.split(), '--out', str(tmp_path / 'out')]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert message in line
    assert not (tmp_path / 'out').exists()


AXIS = Axis('neuron', ('one', 'two'))
VALUES = Quantity('values', 'some values', '1', (AXIS,))


def step(number: int) -> tuple[int, int, int, dict[str, NDArray[np.float64]]]:
    """Return a step of two values."""
    return number * PERIOD_NS, 1, number, {'values': np.full((1, 2), float(number))}


def write_two(file: Path, error: BaseException) -> None:
    """Write two steps, after which there is an error."""
    with written(file, [VALUES], {'controller': 'x'}) as append:
        append(*step(1))
        append(*step(2))
        raise error


def test_after_ctrl_c_the_file_has_what_was_driven_and_says_so(tmp_path: Path) -> None:
    """It can be read like any other."""
    file = tmp_path / 'recording.nc'
    with pytest.raises(Interrupted):
        write_two(file, Interrupted(signal.SIGINT))
    with xr.open_dataset(file) as found:
        assert found.attrs['complete'] == 0
        assert found['values'].values.tolist() == [[1.0, 1.0], [2.0, 2.0]]
    assert list(tmp_path.iterdir()) == [file]


def test_after_an_error_there_is_no_file(tmp_path: Path) -> None:
    """Not a part of one either."""
    with pytest.raises(ZeroDivisionError):
        write_two(tmp_path / 'a.nc', ZeroDivisionError())
    assert list(tmp_path.iterdir()) == []


def test_memory_does_not_grow_with_the_run(tmp_path: Path) -> None:
    """80 MB of samples never take more than 25."""
    large = Quantity(
        'values', 'some values', '1', (Axis('place', tuple(map(str, range(10_000)))),)
    )
    file = RecordingFile(tmp_path / 'large.nc', [large], {})
    sample = {'values': np.arange(10_000.0)[None]}
    tracemalloc.start()
    for number in range(1, 1001):
        file.append(number * PERIOD_NS, 1, number, sample)
    file.close(is_complete=True)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 25e6
    with xr.open_dataset(tmp_path / 'large.nc') as found:
        assert found['values'].shape == (1000, 10_000)
        assert np.array_equal(found['values'][-1], np.arange(10_000.0))


def test_axes_of_one_name_must_have_the_same_labels(tmp_path: Path) -> None:
    """An own controller may get this wrong."""
    others = Quantity('others', 'other values', '1', (Axis('neuron', ('three',)),))
    with pytest.raises(ParameterError, match=r"others: expected the same labels .* 'neuron'"):
        RecordingFile(tmp_path / 'a.nc', [VALUES, others], {})


@pytest.mark.parametrize(
    ('samples', 'message'),
    [
        ({}, 'recorded values: expected an array of the shape (1, 2), got none'),
        (
            {'values': np.zeros(2)},
            'recorded values: expected an array of the shape (1, 2), got one of (2,)',
        ),
    ],
)
def test_samples_that_an_own_controller_gets_wrong_are_named(
    samples: dict[str, Any], message: str, tmp_path: Path
) -> None:
    """Instead of a file that nobody can read."""
    file = RecordingFile(tmp_path / 'a.nc', [VALUES], {})
    with pytest.raises(ParameterError) as caught:
        file.append(PERIOD_NS, 1, 1, samples)
    assert str(caught.value) == message


def test_a_damaged_recording_is_named(lap: spikelane.Run, tmp_path: Path) -> None:
    """A file that breaks off."""
    file = tmp_path / 'recording.nc'
    file.write_bytes(lap.recording.read_bytes()[:5000])
    damaged = spikelane.Run(None, {}, {}, recording=file)
    with pytest.raises(FileError, match=r'recording\.nc: cannot be read: '):
        damaged.recorded('spikes')
