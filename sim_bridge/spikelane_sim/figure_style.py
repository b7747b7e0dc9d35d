"""How all figures look, and how they are saved.

Colours are of Okabe and Ito's palette, which stays apart for colour-blind readers and in grey.
PNG files have a white background. SVG files follow the reader's dark mode, background included.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, TYPE_CHECKING

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.files import write_bytes_atomically

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

INK = '#20262d'  # texts, lines of data
PALE_INK = '#68727d'  # what explains
ROAD = '#ccd3da'
PAINT = '#fefefe'  # not the background's white: it stays white in dark mode
RIGHT = '#0072b2'  # right of the lane's centre
LEFT = '#d55e00'  # left of it
#: Texts on dark and on bright cells of an image, which are the same in dark mode.
ON_DARK, ON_BRIGHT = '#fefefe', '#20262e'

#: Colours of series that have no meaning of their own.
SERIES = (LEFT, RIGHT, '#009e73', '#cc79a7')

#: What becomes of colours in dark mode; all others stay.
DARK_MODE = {
    '#ffffff': '#14181c',
    '#f1f3f5': '#1d2329',
    INK: '#e6eaee',
    PALE_INK: '#a5afb9',
    ROAD: '#3a434c',
    RIGHT: '#56b4e9',
    LEFT: '#ff8c42',
    '#009e73': '#2fc79a',
    '#cc79a7': '#e39fc6',
}

SMALL_PT = 9.0
NORMAL_PT = 10.0
LARGE_PT = 13.0

#: Suffixes of the files that `save` can write.
SUFFIXES = ('.svg', '.png')

_PNG_DPI = 200
_TITLE_IN = 0.18  # of the title's middle, below the figure's top
_MARGIN = 0.012  # left and right of the title, as a share of the figure's width

_SETTINGS: dict[str, Any] = {
    'font.family': 'DejaVu Sans',  # comes with matplotlib, so that it is the same everywhere
    'font.size': NORMAL_PT,
    'text.color': INK,
    'axes.edgecolor': PALE_INK,
    'axes.labelcolor': INK,
    'axes.labelsize': NORMAL_PT,
    'axes.linewidth': 0.8,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.unicode_minus': True,
    'xtick.color': PALE_INK,
    'xtick.labelcolor': INK,
    'xtick.labelsize': SMALL_PT,
    'ytick.color': PALE_INK,
    'ytick.labelcolor': INK,
    'ytick.labelsize': SMALL_PT,
    'lines.solid_capstyle': 'round',
    'lines.solid_joinstyle': 'round',
    'svg.hashsalt': 'spikelane',  # the same drawing gives the same bytes
    'svg.fonttype': 'path',
}


def settings() -> Any:
    """Return a context in which matplotlib draws in our style, whatever the user's own is."""
    import matplotlib
    import matplotlib.style

    return matplotlib.style.context(['default', _SETTINGS])


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return a figure that belongs to nobody's window; call within `settings()`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), facecolor='white')
    FigureCanvasAgg(figure)
    return figure


def write_title(figure: Figure, title: str, explanation: str) -> None:
    """Write what the figure shows at its top left, and a result at its top right."""
    y = 1 - _TITLE_IN / figure.get_figheight()
    figure.text(_MARGIN, y, title, fontsize=LARGE_PT, weight='bold', va='center')
    figure.text(1 - _MARGIN, y, explanation, fontsize=NORMAL_PT, ha='right', va='center')


def write_legend(figure: Figure, handles: list[Artist]) -> None:
    """Explain lines and markers in one row at the figure's foot."""
    figure.legend(
        handles=handles,
        loc='lower left',
        bbox_to_anchor=(0.05, 0.0),
        ncols=max(len(handles), 1),
        fontsize=SMALL_PT,
        frameon=False,
    )


def save(figure: Figure, path: Path) -> tuple[Path, ...]:
    """Write a figure, whole files only; the same figure gives the same bytes.

    Args:
        figure: What to write; call within `settings()`.
        path: Ending in .svg or .png; without an ending both are written.

    Returns:
        The files.

    Raises:
        SpikelaneError: The ending is another.
        FileError: A file cannot be written.
    """
    path = Path(path)
    if path.suffix and path.suffix not in SUFFIXES:
        raise SpikelaneError(f'{path}: expected a name ending in .svg or .png, or without ending')
    paths = (path,) if path.suffix else tuple(path.with_suffix(suffix) for suffix in SUFFIXES)
    for file in paths:
        write_bytes_atomically(file, _encoded(figure, file.suffix))
    return paths


def _encoded(figure: Figure, suffix: str) -> bytes:
    buffer = io.BytesIO()
    if suffix == '.svg':
        figure.savefig(buffer, format='svg', metadata={'Date': None, 'Creator': None})
        rules = f'<style type="text/css">{dark_mode_rules()}</style>\n </defs>\n'.encode()
        return buffer.getvalue().replace(b'</defs>\n', rules, 1)
    figure.savefig(buffer, format='png', dpi=_PNG_DPI, metadata={'Software': None})
    return buffer.getvalue()


def dark_mode_rules() -> str:
    """Return the style sheet that gives an SVG figure its colours for dark mode."""
    rules = (
        f'[style*="{what}: {bright}"]{{{what}:{dark}!important}}'
        for bright, dark in DARK_MODE.items()
        for what in ('fill', 'stroke')
    )
    return f'@media (prefers-color-scheme: dark){{{"".join(rules)}}}'
