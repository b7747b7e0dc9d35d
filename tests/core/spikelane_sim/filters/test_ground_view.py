"""Events of one camera in the image of another."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from spikelane.loop import drive_episode
from spikelane.runs.input_files import input_digests
from spikelane_controllers.registry import make_controller
from spikelane_sim.calibration import Calibration, CalibrationError, write_calibration
from spikelane_sim.errors import ParameterError
from spikelane_sim.events import make_events
from spikelane_sim.filters import FilterParameters, FilterStage
from spikelane_sim.sensor import ReceivedPacket, Sensor
from spikelane_sim.simulated_calibration import simulated_calibration
from spikelane_sim.simulator import Simulator
from spikelane_sim.simulator_parameters import SimulatorParameters

SMALL = Calibration(
    3, 3, (1.0, 1.0), (1.0, 1.0), 'plumb_bob', (0.0,) * 5, (0.2, 0.1, 0.5), (0.0, 45.0, 0.0)
)


def _stage(folder: Path, camera: Calibration, trained: Calibration | None = None) -> FilterStage:
    values = {'chain': 'ground_view', 'ground_view.file': str(folder / 'camera.yaml')}
    write_calibration(folder / 'camera.yaml', camera)
    if trained is not None:
        write_calibration(folder / 'trained.yaml', trained)
        values['ground_view.trained_file'] = str(folder / 'trained.yaml')
    return FilterStage(FilterParameters.from_mapping(values), camera.width, camera.height)


def test_the_same_camera_moves_no_event(tmp_path: Path) -> None:
    """Except above the horizon, where there is no floor."""
    stage = _stage(tmp_path, SMALL, SMALL)
    assert stage.size == (3, 3)
    events = make_events([5, 5, 6, 7], [0, 2, 1, 1], [1, 1, 2, 0], [1, -1, 1, 1])
    assert stage.filter(events).tolist() == events[:3].tolist()
    assert (stage.events_in, stage.events_out) == (4, 3)


def test_a_finer_trained_camera_gets_each_event_several_times(tmp_path: Path) -> None:
    """9 x 9 pixels of a third of the size: the middle pixel is nine of theirs, in order."""
    fine = SMALL._replace(width=9, height=9, focal_px=(3.0, 3.0), centre_px=(4.0, 4.0))
    moved = _stage(tmp_path, SMALL, fine).filter(make_events([5], 1, 1, -1))
    assert moved['x'].tolist() == [3, 4, 5] * 3
    assert moved['y'].tolist() == [3] * 3 + [4] * 3 + [5] * 3
    assert set(moved['t'].tolist()) == {5}
    assert set(moved['polarity'].tolist()) == {-1}


def test_a_coarser_trained_camera_gets_the_events_at_its_centres(tmp_path: Path) -> None:
    """One of nine fine pixels sees the same point of the floor as the centre of a coarse pixel."""
    fine = SMALL._replace(width=9, height=9, focal_px=(3.0, 3.0), centre_px=(4.0, 4.0))
    events = make_events(np.arange(9), [3, 4, 5] * 3, [3] * 3 + [4] * 3 + [5] * 3, 1)
    assert _stage(tmp_path, fine, SMALL).filter(events).tolist() == [(4, 1, 1, 1)]


@pytest.mark.parametrize(
    ('size', 'fov_deg', 'look_ahead_m'),
    [((346, 260), 90, 0.0), ((346, 260), 60, 0.08), ((640, 480), 90, 0.0), ((640, 480), 60, 0.08)],
)
def test_another_camera_drives_with_the_shipped_weights(
    tmp_path: Path, size: tuple[int, int], fov_deg: int, look_ahead_m: float
) -> None:
    """0.4 m high, 45 degrees down: an outer lap of scenario 1 with at most 0.015 m of error."""
    parameters = SimulatorParameters.from_mapping(
        {
            'robot.engine': 'rigid',
            'camera.width': size[0],
            'camera.height': size[1],
            'camera.fov_deg': fov_deg,
            'camera.pitch_deg': 45,
            'camera.z_m': 0.4 - 0.13879,
            'episode.max_laps': 1,
        }
    )
    file = tmp_path / 'camera.yaml'
    write_calibration(file, simulated_calibration(parameters))
    filters = FilterParameters.from_mapping(
        {
            'chain': 'ground_view',
            'ground_view.file': str(file),
            'ground_view.look_ahead_m': look_ahead_m,
        }
    )
    errors_m: list[float] = []
    with Simulator(parameters) as simulator:
        last = drive_episode(
            simulator,
            make_controller('rstdp', {}),
            lambda seen, _: errors_m.append(abs(seen.lane.distance_m)) if seen.lane else None,
            lane='outer',
            filters=filters,
        )
    assert last.lane is not None
    assert last.lane.reason == 'laps_complete'
    assert float(np.mean(errors_m)) <= 0.015


def test_steps_of_packets_have_the_trained_camera_s_image(tmp_path: Path) -> None:
    """A simulator's packets of another size are refused without the map, and taken with it."""
    write_calibration(tmp_path / 'camera.yaml', SMALL)
    trained = SMALL._replace(width=4, centre_px=(1.0, 1.0))
    write_calibration(tmp_path / 'trained.yaml', trained)
    filters = FilterParameters.from_mapping(
        {
            'chain': 'ground_view',
            'ground_view.file': str(tmp_path / 'camera.yaml'),
            'ground_view.trained_file': str(tmp_path / 'trained.yaml'),
        }
    )
    # mono: a time of 10 us and the column and row 1 of one ON event in eight bytes.
    data = (1 << 63 | 1 << 48 | 1 << 32 | 10_000).to_bytes(8, 'little')
    packet = ReceivedPacket(50_000_000, 1, 'mono', data, 0, 3, 3)
    with pytest.raises(ParameterError, match='expected a simulator'):
        Sensor(width=4, height=3, has_lane=True).add(packet)
    (step,) = Sensor(filters=filters, width=4, height=3, has_lane=True).add(packet)
    assert step.events.tolist() == [(10_000, 1, 1, 1)]


def test_the_content_of_both_files_determines_a_run(tmp_path: Path) -> None:
    """A run is told from one with another calibration under the same name."""
    names = [str(tmp_path / name) for name in ('camera.yaml', 'trained.yaml')]
    for name in names:
        Path(name).write_text(name)
    given = dict(zip(('ground_view.file', 'ground_view.trained_file'), names, strict=True))
    digests = input_digests({'filter': {'chain': 'ground_view', **given}})
    assert digests == {name: hashlib.sha256(name.encode()).hexdigest() for name in names}


def test_calibrations_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    """None, of another size, a distorted trained one, and two that see nothing in common."""
    with pytest.raises(
        ParameterError, match=r"filter\.ground_view\.file: expected the path .* got ''"
    ):
        FilterStage(FilterParameters.from_mapping({'chain': 'ground_view'}), 3, 3)
    write_calibration(tmp_path / 'camera.yaml', SMALL)
    one = FilterParameters.from_mapping(
        {'chain': 'ground_view', 'ground_view.file': str(tmp_path / 'camera.yaml')}
    )
    with pytest.raises(
        CalibrationError, match='a camera of 4 x 3 px, got that of one of 3 x 3 px'
    ):
        FilterStage(one, 4, 3)
    with pytest.raises(CalibrationError, match='expected a trained camera without distortion'):
        _stage(tmp_path, SMALL, SMALL._replace(distortion=(0.1, 0.0, 0.0, 0.0, 0.0)))
    with pytest.raises(CalibrationError, match='got a camera that sees none of it'):
        _stage(tmp_path, SMALL._replace(place_m=(50.0, 0.0, 0.5)), SMALL)
