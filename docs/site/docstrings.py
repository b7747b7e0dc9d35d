"""What docstrings and fields need so that Sphinx shows them as they are meant."""

from __future__ import annotations

from collections.abc import Iterator
import importlib
import inspect
import re
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_OF_NAMEDTUPLE = 'Alias for field number'


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to the reading of docstrings."""
    app.setup_extension('sphinx.ext.autodoc')
    app.connect('autodoc-process-docstring', adapt, priority=900)  # after Napoleon
    app.connect('autodoc-process-signature', hide_signature)
    return {'parallel_read_safe': True}


def adapt(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Take headings and fences of Markdown, and for a tuple's field the comment after it."""
    if lines and lines[0].startswith(_OF_NAMEDTUPLE):
        lines[:] = [_comment(*name.rsplit('.', 1))]
    else:
        lines[:] = _without_markdown(lines)


def hide_signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, arguments: str, result: str
) -> tuple[str, str] | None:
    """Hide the signature of what nobody makes: protocols."""
    return ('', '') if getattr(thing, '_is_protocol', False) else None


def _without_markdown(lines: list[str]) -> Iterator[str]:
    """Yield the lines of a docstring, headings of Markdown as bold lines."""
    for line in lines:
        if line.startswith('## '):
            yield from ('', f'**{line[3:]}**', '')
        else:
            yield line


def _comment(owner: str, field: str) -> str:
    """Return the comment after a field in the source of its class, '' for none."""
    module, _, name = owner.rpartition('.')
    source = inspect.getsource(getattr(importlib.import_module(module), name))
    match = re.search(rf'^ +{field}: [^#\n]*# (.+)$', source, re.M)
    return re.sub(r'([*_|`\\])', r'\\\1', match[1]) if match else ''
