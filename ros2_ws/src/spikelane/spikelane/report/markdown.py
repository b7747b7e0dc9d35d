"""The tables of a report in Markdown, to be copied into a page of results."""

from __future__ import annotations

from collections.abc import Iterable

from spikelane.markdown import markdown_table
from spikelane.report.groups import Table
from spikelane.report.origin import MadeWith


def tables_in_markdown(tables: Iterable[Table], made: Iterable[MadeWith]) -> str:
    """Return all tables, each with its title and note, and what computed the runs."""
    parts = [
        '\n'.join(
            [
                f'## {table.title}\n',
                markdown_table(table.header, table.rows),
                *([f'\n{table.note}'] if table.note else []),
            ]
        )
        for table in tables
    ]
    parts.extend(
        f'{each.runs} runs at commit {each.commit}: {each.machine}, {each.versions}.'
        for each in made
    )
    return '\n\n'.join(parts) + '\n'
