"""The report itself: one HTML file that holds everything, with its figures next to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
import shlex
from typing import Any

from spikelane.report.drawing import draw_figures, Drawn, OnFigure, runs_to_draw
from spikelane.report.embedding import Embedded, embedded
from spikelane.report.groups import PLACE, place_in_words, Table
from spikelane.report.markdown import tables_in_markdown
from spikelane.report.origin import all_commands, Commands, made_with, NOT_RECORDED
from spikelane.report.runs import LeftOut, Runs
from spikelane.report.tables import all_tables
from spikelane.runs.folder import versions
from spikelane_sim.figure_style import dark_mode_rules
from spikelane_sim.files import FileError, write_json, write_text_atomically, WriteError

PAGE = 'report.html'

_TABLES = 'report.json'
_MARKDOWN = 'report.md'
_TEMPLATE = 'page.html'
#: Letters of a word from which on it is broken anywhere.
_LONG_WORD = 22


def write_report(
    paths: Sequence[Path], out: Path, show: OnFigure, note: str = ''
) -> dict[str, Any]:
    """Write a report on all runs in some folders.

    Args:
        paths: Folders of runs, or above them.
        out: Folder of the report: `report.html`, `report.json` and `report.md` with its tables,
            `figures/`.
        show: Called with the name of what is being done.
        note: What readers must know first, '' for nothing.

    Returns:
        Where everything is, ready for JSON: `page`, `note`, `runs` (how many), `tables` (as
        written into `report.json`), `commands` that made the runs, `made_with` (versions and
        machines), `figures` and `left_out`.

    Raises:
        ReportError: There is nothing to report on.
        FileError: A file cannot be written; the message says what the report lacks because of it.
    """
    show('reading')
    runs = runs_to_draw(paths)
    tables = all_tables(runs)
    figures, not_drawn, unwritten = draw_figures(runs, out / 'figures', show, paths)
    commands, not_told = all_commands(runs)
    left_out = [*runs.left_out, *not_drawn, *not_told]
    command = shlex.join(['./spikelane', 'report', *map(str, paths)])
    page = _page(runs, tables, figures, commands, left_out, command, note)
    result = {
        'page': str(out / PAGE),
        'note': note,
        'runs': len(runs),
        'tables': [table._asdict() for table in tables],
        'commands': [each._asdict() for each in commands],
        'made_with': [each._asdict() for each in made_with(runs)],
        'figures': [str(file) for figure in figures for file in figure.files],
        'left_out': [each._asdict() for each in left_out],
    }
    failed = {f'figure {name}': error for name, error in unwritten.items()}
    writers: dict[str, Callable[[], None]] = {
        f'page ({PAGE})': lambda: write_text_atomically(out / PAGE, page),
        f'tables ({_TABLES})': lambda: write_json(out / _TABLES, result),
        f'tables ({_MARKDOWN})': lambda: write_text_atomically(
            out / _MARKDOWN, tables_in_markdown(tables, made_with(runs))
        ),
    }
    for what, write in writers.items():
        try:
            write()
        except WriteError as error:
            failed[what] = error
    if failed:
        cause = next(iter(failed.values()))
        raise FileError(f'{cause}; the report lacks: {", ".join(failed)}') from cause
    return result


def _page(
    runs: Runs,
    tables: Sequence[Table],
    figures: Sequence[Drawn],
    commands: Sequence[Commands],
    left_out: Sequence[LeftOut],
    command: str,
    note: str,
) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    parts: dict[str, list[Embedded]] = {}
    for figure in figures:
        parts.setdefault(figure.heading, []).append(embedded(figure.caption, figure.files))
    return environment.get_template(_TEMPLATE).render(
        runs=runs,
        tables=[(table, _brief(table)) for table in tables],
        is_long=_has_long_word,
        dark_mode=dark_mode_rules(),
        parts=parts,
        commands=commands,
        left_out=left_out,
        command=command,
        note=note,
        commit=versions()['commit'] or NOT_RECORDED,
        machine=versions()['machine'],
        made_with=made_with(runs),
    )


def _brief(table: Table) -> Table | None:
    """Return what a reader needs first of a table, None where that is nothing."""
    if not table.brief:
        return None
    cells = [dict(zip(table.header, row, strict=True)) for row in table.rows]
    is_placed = PLACE[0] in table.header
    rows = [
        (*([place_in_words(each)] if is_placed else []), *(each[name] for name in table.brief))
        for each in cells
    ]
    first = ('controller and scenario',) if is_placed else ()
    return table._replace(header=(*first, *table.brief), rows=rows)


def _has_long_word(text: str) -> bool:
    return any(len(word) > _LONG_WORD for word in text.split())
