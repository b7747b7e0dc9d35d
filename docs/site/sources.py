"""Links to files and folders of the repository: each leads to a page that shows it.

On GitHub, such a link opens GitHub's own page of the file. The site has a page for every file or
folder that a page links to, below `source/`.
"""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from pathlib import Path
import posixpath
import re
from typing import Any, TYPE_CHECKING

from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import get_lexer_for_filename, TextLexer
from pygments.util import ClassNotFound
from sphinx.util.osutil import relative_uri

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.environment import BuildEnvironment

#: What the site has as pages of its own.
_PAGES = ('.md', '.ipynb')
#: Caches, builds and the like.
_LEFT = re.compile(r'(^|/)(\.|__pycache__/|build/|[^/]+\.egg-info/)')
_LINK = re.compile(r'(?<=\]\()([^)\s#:]+)(?=\))')
#: How files are coloured whose names say nothing to Pygments.
_AS = {'.urdf': 'x.xml', '.cff': 'x.yaml', '.msg': 'x.sh', '.srv': 'x.sh', '.action': 'x.sh'}
#: In front of the path in a marked link.
_MARK = 'https://source.invalid/'


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to the steps of a build."""
    app.connect('source-read', mark_links)
    app.connect('doctree-resolved', lead_links)
    app.connect('html-collect-pages', source_pages)
    return {'parallel_read_safe': True}


def mark_links(app: Sphinx, name: str, source: list[str]) -> None:
    """Mark the links of a page to what is no page itself, so that MyST leaves them alone."""
    root = Path(app.srcdir)
    here = posixpath.dirname(name)

    def mark(match: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(here, match[1]))
        file = root / path
        is_image = match.string[: match.start()].rpartition('\n')[2].rpartition('[')[0][-1:] == '!'
        if is_image or not file.exists() or file.suffix in _PAGES:
            return match[0]
        return _MARK + path

    source[0] = _LINK.sub(mark, source[0])


def lead_links(app: Sphinx, tree: nodes.document, name: str) -> None:
    """Let the marked links of a page lead to the pages of what they name."""
    for link in tree.findall(nodes.reference):
        address = link.get('refuri', '')
        if address.startswith(_MARK):
            path = address.removeprefix(_MARK)
            _linked(app.env).add(path)
            link['refuri'] = relative_uri(app.builder.get_target_uri(name), f'source/{path}.html')
            link['internal'] = True


def source_pages(app: Sphinx) -> Iterator[tuple[str, dict[str, Any], str]]:
    """Yield the pages of all files and folders that are linked to, and of what folders contain."""
    root = Path(app.srcdir)
    todo, done = sorted(_linked(app.env)), set()
    while todo:
        path = todo.pop()
        if path in done:
            continue
        done.add(path)
        if (root / path).is_dir():
            inside = _files(root / path)
            todo += [f'{path}/{each}' for each in inside]
            links = ''.join(
                f'<li><a href="{posixpath.basename(path)}/{each}.html">{each}</a></li>'
                for each in inside
            )
            body = f'<ul>{links}</ul>'
        else:
            body = _shown(root / path)
        body = f'<h1><code>{escape(path)}</code></h1><div class="source">{body}</div>'
        yield f'source/{path}', {'title': escape(path), 'body': body}, 'page.html'


def _files(folder: Path) -> list[str]:
    """Return the files in a folder and those below it, without what programs leave there."""
    inside = (file.relative_to(folder) for file in folder.rglob('*') if file.is_file())
    return sorted(str(file) for file in inside if not _LEFT.search(str(file)))


def _shown(file: Path) -> str:
    """Return the coloured text of a file as HTML."""
    try:
        text = file.read_text('utf-8')
    except UnicodeDecodeError:
        return f'<p>{file.stat().st_size:,} bytes that are no text.</p>'
    try:
        lexer = get_lexer_for_filename(_AS.get(file.suffix, file.name))
    except ClassNotFound:
        lexer = TextLexer()
    return str(highlight(text, lexer, HtmlFormatter(cssclass='highlight')))


def _linked(env: BuildEnvironment) -> set[str]:
    """Return the set of linked paths, which the build keeps."""
    if not hasattr(env, 'spikelane_linked'):
        env.spikelane_linked = set()  # type: ignore[attr-defined]
    return env.spikelane_linked  # type: ignore[attr-defined, no-any-return]
