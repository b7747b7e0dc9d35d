"""The navigation of the site: what docs/README.md lists, under its headings.

GitHub shows docs/README.md as a page of links. The site's sidebar has the same headings with the
same pages, so that the list is kept in one place.
"""

from __future__ import annotations

import os
from pathlib import Path
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

CONTENTS = 'docs/README'
_LINK = re.compile(r'\[([^\]]+)\]\(([^)#]+\.(?:md|ipynb))\)')


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the navigation to the first page."""
    app.connect('source-read', add_navigation)
    return {'parallel_read_safe': True}


def add_navigation(app: Sphinx, name: str, source: list[str]) -> None:
    """Append lists of pages, hidden: to the first page what docs/README.md lists.

    The README of another folder has the pages of that folder.
    """
    if name == app.config.root_doc:
        contents = Path(app.srcdir, f'{CONTENTS}.md')
        source[0] += '\n\n' + '\n\n'.join(navigation(contents.read_text('utf-8')))
        source[0] += f'\n\n```{{toctree}}\n:hidden:\n\nAll pages </{CONTENTS}>\n```\n'
    elif name != CONTENTS and name.startswith('docs/') and name.endswith('/README'):
        source[0] += '\n\n```{toctree}\n:hidden:\n:glob:\n\n*\n```\n'


def navigation(contents: str) -> list[str]:
    """Return a directive for each heading of a page of links, with its pages in their order."""
    return [
        '\n'.join(
            [
                '```{toctree}',
                f':caption: {heading}',
                ':hidden:',
                '',
                *(f'{title} </{_document(target)}>' for title, target in _LINK.findall(text)),
                '```',
            ]
        )
        for heading, text in re.findall(r'^## (.+)\n((?:(?!## ).*\n?)*)', contents, re.M)
    ]


def _document(target: str) -> str:
    """Return the name that Sphinx has for a page, from its place relative to docs/README.md."""
    return os.path.splitext(os.path.normpath(f'docs/{target}'))[0]
