"""A run that is over, to be looked at: its configuration, its results and its tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TYPE_CHECKING

from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.trajectory import read_csv
from spikelane_controllers.weights import find_checkpoint
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.parsing import ParseError, read_yaml_file

if TYPE_CHECKING:
    import pandas as pd


class RunError(SpikelaneError):
    """A run's folder is not one, or does not have what is asked for."""


class Run:
    """What a run left.

    Tables are read when they are first asked for. Each property says its columns with units, and
    raises a `RunError` where this kind of run does not have the table.

    Attributes:
        folder: Its folder; None where nothing was written.
        config: Everything that determines the run, with seeds and versions (`config.yaml`).
        metrics: What came out (`metrics.json`).
    """

    def __init__(
        self,
        folder: Path | None,
        config: Mapping[str, Any],
        metrics: Mapping[str, Any],
        tables: Mapping[str, pd.DataFrame] | None = None,
        recording: Path | None = None,
        keep: object = None,
    ) -> None:
        """Take what is known already.

        Args:
            folder: As in the class.
            config: As in the class.
            metrics: As in the class.
            tables: Tables that need not be read, by the property's name.
            recording: File of the recording, where it is not in the folder.
            keep: What must live as long as the run.
        """
        self.folder = folder
        self.config = dict(config)
        self.metrics = dict(metrics)
        self._recording = recording
        self._keep = keep
        self._tables: dict[str, pd.DataFrame] = dict(tables or {})

    def __repr__(self) -> str:
        """Say which run it is."""
        where = 'nothing written' if self.folder is None else self.folder
        return f'Run({where}: {self.config.get("controller")}, seed {self.config.get("seed")})'

    @property
    def trajectory(self) -> pd.DataFrame:
        """The drive of a lap, one row for each observation, the one at the reset included.

        Columns: `stamp_ns` simulation time [ns]; `step` steps of 50 ms since the reset;
        `distance_m` from the lane's centre [m], right of it positive; `heading_error_rad` robot's
        heading less the lane's [rad], left positive; `position_m` along the lane's centre from
        its first section's start [m]; `progress_m` along it since the reset, over laps [m];
        `section` name of the section; `laps` completed; `x_m`, `y_m` position in the world [m];
        `heading_rad` in the world, counter-clockwise from x [rad]; `left_rad_s`, `right_rad_s`
        command that answered the observation [rad/s]; `events` their number in the observation.
        """
        return self._table('trajectory', self._read_trajectory)

    @property
    def events(self) -> pd.DataFrame:
        """The events of a lap, one row each, in the order of time.

        Columns: `stamp_ns` of the observation that has it [ns]; `t_ns` its own simulation time
        [ns]; `x_px`, `y_px` column and row of the pixel, from the top left; `polarity` 1 brighter,
        -1 darker. They are those of the camera, before any filter. A lap that `drive` drove has
        them, and one that was recorded over ROS.
        """
        from spikelane.frames import recorded_events

        return self._table(
            'events', lambda: recorded_events(self._bag(), self.trajectory['stamp_ns'])
        )

    @property
    def spikes(self) -> pd.DataFrame:
        """The spikes of a lap, one row for each observation and neuron that the controller shows.

        Columns: `stamp_ns` of the observation answered [ns]; `neuron` its name; `spikes` how
        often it fired in the step. No rows where there are no spiking neurons. The laps that have
        them are those that have `events`.
        """
        from spikelane.frames import recorded_spikes

        return self._table(
            'spikes', lambda: recorded_spikes(self._bag(), self.trajectory['stamp_ns'])
        )

    @property
    def recording(self) -> Path:
        """The file of what the controller recorded of itself: NetCDF, for `xarray.open_dataset`.

        A run has it where it was asked for, with `record=` or `--record`. Of a run without a
        folder it is in a temporary one, which is removed together with this object.
        """
        if self._recording is not None:
            return self._recording
        return self._file('recording.nc', 'a run with --record')

    def recorded(self, quantity: str) -> pd.DataFrame:
        """Return a quantity that the controller recorded, in the order of time.

        Args:
            quantity: Its name, as 'spikes' or 'weights'.

        Returns:
            `time_ns` simulation time [ns]; a category for each axis, as `neuron` and `input`
            ('row,column' of the input's cell in the image); and except of spikes `value` in the
            quantity's unit, the attribute `units` of the variable in the file.

        Raises:
            RunError: The run has no recording, or the recording not this quantity.
            FileError: It cannot be read.
        """
        from spikelane.recording.tables import recorded_names, recorded_table

        names = recorded_names(self.recording)
        if quantity not in names:
            raise RunError(
                f'{self.recording}: expected one of {", ".join(names)}, got {quantity!s:.80}'
            )
        return self._table(
            f'recorded {quantity}', lambda: recorded_table(self.recording, quantity)
        )

    @property
    def weights(self) -> pd.DataFrame:
        """The weights learnt in a training, or those that a lap was driven with; one row each.

        Columns: `array` name of the array in the checkpoint; `row` and `column` of the weight in
        it, from 0 (a row is a neuron, a column one of its inputs; a bias is in column 0);
        `weight` in the unit that the array's name ends with, pA for R-STDP, else 1.
        """
        return self._table('weights', self._read_weights)

    @property
    def episodes(self) -> pd.DataFrame:
        """The episodes of a training, one row each: the columns of `episodes.csv`."""
        return self._table('episodes', self._read_episodes)

    @property
    def laps(self) -> pd.DataFrame:
        """The laps of an evaluation, one row each.

        Columns are the metrics of a lap, such as `course`, `lane`, `seed`, `completed`, `reason`,
        `steps`, `mean_abs_distance_m` [m] and `progress_m` [m].
        """
        return self._table('laps', self._read_laps)

    def _table(self, name: str, read: Callable[[], pd.DataFrame]) -> pd.DataFrame:
        if name not in self._tables:
            self._tables[name] = read()
        return self._tables[name]

    def _file(self, name: str, kind: str) -> Path:
        """Return the path of a file that a kind of run leaves.

        Raises:
            RunError: This run has not.
        """
        if self.folder is None or not (self.folder / name).exists():
            where = 'a run that wrote nothing' if self.folder is None else self.folder
            raise RunError(f'{where}: expected {name}, which {kind} leaves, got none')
        return self.folder / name

    def _bag(self) -> Path:
        return self._file('bag', 'a lap that was recorded over ROS')

    def _read_trajectory(self) -> pd.DataFrame:
        from spikelane.frames import trajectory_frame

        return trajectory_frame(read_csv(self._file('trajectory.csv', 'a lap')))

    def _read_episodes(self) -> pd.DataFrame:
        import pandas as pd

        return pd.read_csv(self._file('episodes.csv', 'a training'))

    def _read_laps(self) -> pd.DataFrame:
        import pandas as pd

        self._file('laps', 'an evaluation')
        return pd.DataFrame(self.metrics['laps'])

    def _read_weights(self) -> pd.DataFrame:
        from spikelane.frames import learnt_weights

        controller = self.config['controller']
        driven_with = self.config.get(controller, {}).get('checkpoint')
        if driven_with:
            return learnt_weights(controller, find_checkpoint(controller, driven_with))
        file = self._file('checkpoint.safetensors', 'a training')
        return learnt_weights(controller, file)


def load_run(folder: str | Path) -> Run:
    """Return a run from the folder that it left.

    Args:
        folder: Folder of a lap, a training, an evaluation, a transfer or a replay.

    Raises:
        RunError: It is no folder of a run, or of one that is not over.
    """
    path = Path(folder)
    found = RunFolder(path)
    try:
        config = read_yaml_file(found.config)
    except ParseError as error:
        raise RunError(
            f"{path}: expected a run's folder, got none: config.yaml: {error}"
        ) from None
    if not isinstance(config, Mapping):
        raise RunError(f'{found.config}: expected a mapping, got {config!r:.80}')
    if not found.metrics.exists():
        raise RunError(f'{path}: expected a run that is over, got one without metrics.json')
    return Run(path, config, found.read_metrics())
