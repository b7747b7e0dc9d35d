"""Draws the report's figures; a second process helps where there are many.

Both processes know the same figures. Each takes the next one that nobody has taken, one from the
front and the other from the back, by making a file of its name in a folder of claims. The second
process (`python -m spikelane.report.drawing FOLDER CLAIMS PATH...`) writes what came of its
figures into `CLAIMS/outcomes.json`. If it ends without this file, or has drawn another figure
under the same name since a run was finished meanwhile, the first process draws the figure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
import contextlib
import json
import os
from pathlib import Path
import sys
import tempfile
from typing import NamedTuple

from spikelane.interruption import check, checking
from spikelane.processes import ProcessError, Processes
from spikelane.report.collect import collect
from spikelane.report.figures import all_figures, ReportFigure
from spikelane.report.kinds import UNUSABLE
from spikelane.report.missing import missing
from spikelane.report.naming import name_settings
from spikelane.report.runs import LeftOut, Runs
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import write_json, WriteError

#: Number of figures from which on a second process saves time.
_MANY = 12
_OUTCOMES = 'outcomes.json'
_HELPER = 'second process that draws'
#: Longest wait for the second process, once nothing is left to take [s].
_LONGEST_S = 600.0


class Drawn(NamedTuple):
    """A figure that is drawn.

    Attributes:
        heading: Heading of the part of the page it belongs to.
        caption: What it shows, of which run.
        files: Its files; the smallest is shown.
    """

    heading: str
    caption: str
    files: tuple[Path, ...]


#: Shows what is being drawn.
OnFigure = Callable[[str], None]


class Figures(NamedTuple):
    """The result of drawing.

    Attributes:
        drawn: The figures in the order of the page.
        left_out: What could not be drawn, and why.
        unwritten: Names of the figures that could not be written, with the errors.
    """

    drawn: list[Drawn]
    left_out: list[LeftOut]
    unwritten: dict[str, WriteError]


class _Outcome(NamedTuple):
    """What came of one figure, ready for JSON.

    Attributes:
        files: Its files; none where it could not be drawn.
        reason: Why it could not, '' where it could.
        is_unwritten: Whether that is because a file could not be written.
        caption: Caption of the figure.
    """

    files: tuple[str, ...]
    reason: str
    is_unwritten: bool
    caption: str


def runs_to_draw(paths: Sequence[Path]) -> Runs:
    """Return all runs in some folders, with the names that figures give to their settings.

    Raises:
        ReportError: There are none.
    """
    runs = collect(paths)
    name_settings(runs)
    return runs


def draw_figures(runs: Runs, folder: Path, show: OnFigure, paths: Sequence[Path] = ()) -> Figures:
    """Draw all figures that these runs have something for.

    Args:
        runs: To draw.
        folder: Folder of the files.
        show: Called with the name of what this process is drawing.
        paths: Where `runs_to_draw` has found the runs, so that a second process can find them,
            too; none to draw all in this one.

    Raises:
        Interrupted: A signal has come.
    """
    figures = list(all_figures(runs, folder))
    outcomes: dict[str, _Outcome] = {}
    if paths and len(figures) >= _MANY and len(os.sched_getaffinity(0)) > 1:
        outcomes = _draw_in_two(figures, folder, show, paths)
    for figure in figures:
        if figure.name not in outcomes:
            show(figure.name)
            check()
            outcomes[figure.name] = _outcome_of(figure)
    drawn: list[Drawn] = []
    left_out: list[LeftOut] = []
    for figure in figures:
        outcome = outcomes[figure.name]
        if outcome.reason:
            left_out.append(LeftOut(figure.caption, outcome.reason))
        else:
            files = tuple(Path(file) for file in outcome.files)
            drawn.append(Drawn(figure.heading, figure.caption, files))
    unwritten = {
        name: WriteError(each.reason) for name, each in outcomes.items() if each.is_unwritten
    }
    return Figures(drawn, left_out + list(missing(runs)), unwritten)


def _draw_in_two(
    figures: Sequence[ReportFigure], folder: Path, show: OnFigure, paths: Sequence[Path]
) -> dict[str, _Outcome]:
    """Return what came of the figures that this process or the second one has drawn."""
    outcomes: dict[str, _Outcome] = {}
    try:
        with (
            checking(),
            tempfile.TemporaryDirectory(prefix='spikelane-') as name,
            Processes() as processes,
        ):
            claims = Path(name, 'claims')
            claims.mkdir()
            module = [sys.executable, '-m', __spec__.name]
            words = [str(each) for each in (folder, claims, *paths)]
            processes.start(_HELPER, module + words, Path(name, 'log'), os.environ)
            for figure in _claimed(figures, claims):
                show(figure.name)
                check()
                outcomes[figure.name] = _outcome_of(figure)
            if len(outcomes) < len(figures):
                processes.wait(_HELPER, _LONGEST_S)
                outcomes |= _of_the_second(figures, claims / _OUTCOMES)
    except (ProcessError, OSError) as error:
        # The caller draws what is missing.
        show(f'one process alone: {error}')
    return outcomes


def _of_the_second(figures: Sequence[ReportFigure], file: Path) -> dict[str, _Outcome]:
    """Read what the second process has drawn of these figures."""
    captions = {figure.name: figure.caption for figure in figures}
    found = {name: _Outcome(*each) for name, each in json.loads(file.read_text('utf-8')).items()}
    return {name: each for name, each in found.items() if each.caption == captions.get(name)}


def _claimed(figures: Iterable[ReportFigure], claims: Path) -> Iterator[ReportFigure]:
    """Yield the figures that nobody has taken yet, each after it was taken."""
    for figure in figures:
        with contextlib.suppress(FileExistsError):
            (claims / figure.name).touch(exist_ok=False)
            yield figure


def _outcome_of(figure: ReportFigure) -> _Outcome:
    """Draw a figure."""
    files: tuple[Path, ...] = ()
    reason, is_unwritten = '', False
    try:
        files = figure.draw()
    except SpikelaneError as error:
        reason, is_unwritten = str(error), isinstance(error, WriteError)
    except KeyError as error:
        reason = f'the run was made with another version of Spikelane and lacks {error}'
    except UNUSABLE as error:
        # A file of one run is damaged: it must not cost the report of all others.
        reason = f'a file of the run is damaged: {error}'
    return _Outcome(tuple(map(str, files)), reason, is_unwritten, figure.caption)


def main() -> None:
    """Draw what nobody has taken yet, from the last figure on."""
    folder, claims, *paths = (Path(word) for word in sys.argv[1:])
    figures = list(all_figures(runs_to_draw(paths), folder))
    outcomes = {figure.name: _outcome_of(figure) for figure in _claimed(reversed(figures), claims)}
    write_json(claims / _OUTCOMES, outcomes)


if __name__ == '__main__':
    main()
