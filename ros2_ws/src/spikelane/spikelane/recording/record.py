"""Recording a run as it goes on: what is asked for, and the file that it makes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
import contextlib
from pathlib import Path
import tempfile
from typing import Any, NamedTuple

from spikelane.interruption import checking, Interrupted
from spikelane.runs.configuration import Configuration, configured_controller
from spikelane_controllers.quantities import begin_to_record, chosen_quantities, Quantity
from spikelane_controllers.shown import shown_by
from spikelane_sim.contract import Controller, Observation
from spikelane_sim.errors import ParameterError
from spikelane_sim.files import path_written_whole

#: Records the step that has just been driven.
RecordStep = Callable[[Observation], None]


class Recording(NamedTuple):
    """What is to be recorded of a run.

    Attributes:
        path: The file.
        names: Names of quantities that the controller offers, or 'all'.
    """

    path: Path
    names: tuple[str, ...]


def temporary_recording(names: tuple[str, ...]) -> tuple[Recording, object]:
    """Return a recording in a folder that is removed together with the second object."""
    folder = tempfile.TemporaryDirectory(prefix='spikelane-')
    return Recording(Path(folder.name, 'recording.nc'), names), folder


def parse_names(text: str | None) -> tuple[str, ...]:
    """Return the names in a text such as 'spikes,traces'; none for None.

    Raises:
        ParameterError: There is an empty name.
    """
    names = () if text is None else tuple(each.strip() for each in text.split(','))
    if not all(names):
        raise ParameterError(f'record: expected names with commas between them, got {text!r}')
    return names


def check_recordable(config: Configuration, names: Collection[str]) -> None:
    """Check that the controller of a run offers what is to be recorded.

    Raises:
        SpikelaneError: It does not, or cannot be made.
    """
    if names:
        offered = shown_by(configured_controller(config)).quantities
        chosen_quantities(config.controller, offered, names)


def facts_of(config: Configuration) -> dict[str, Any]:
    """Return what the file says of the run."""
    return {
        'controller': config.controller,
        'scenario': config.scenario,
        'seed': config.seed,
        'period_ms': config.simulator.period_ms,
    }


@contextlib.contextmanager
def recorded(
    controller: Controller, recording: Recording | None, facts: Mapping[str, Any]
) -> Iterator[RecordStep]:
    """Give what records the steps of a controller; the file is there after the block.

    Where a signal ends the block, the file has what was driven until then, and says so: `check`
    is called between the steps. After any other error there is no file.

    Args:
        controller: What drives, after each step.
        recording: What is recorded; None for nothing.
        facts: Attributes of the file, among them the name of the controller.

    Raises:
        SpikelaneError: The controller does not offer it, or the file cannot be written.
    """
    if recording is None:
        yield lambda observation: None
        return
    quantities = begin_to_record(str(facts['controller']), controller, recording.names)
    with written(recording.path, quantities, facts) as append:

        def record(observation: Observation) -> None:
            lane = observation.lane
            episode, step = (0, 0) if lane is None else (lane.episode, lane.step)
            append(observation.stamp_ns, episode, step, shown_by(controller).recorded)

        yield record


@contextlib.contextmanager
def written(
    path: Path, quantities: Collection[Quantity], facts: Mapping[str, Any]
) -> Iterator[Callable[..., None]]:
    """Give `RecordingFile.append` of a new file; see `recorded`."""
    # Whoever records nothing need not wait for HDF5.
    from spikelane.recording.file import RecordingFile

    interrupted: Interrupted | None = None
    with path_written_whole(path) as part:
        file = RecordingFile(part, tuple(quantities), facts)
        try:
            with checking():
                yield file.append
        except Interrupted as error:
            interrupted = error
        except BaseException:
            with contextlib.suppress(Exception):
                file.abandon()
            raise
        file.close(is_complete=interrupted is None)
    if interrupted is not None:
        raise interrupted
