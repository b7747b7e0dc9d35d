"""Figures within a page: drawings as elements of it, so that they tell values, and pictures."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
import re
from typing import NamedTuple

_KINDS = {'.png': 'image/png', '.webp': 'image/webp'}
#: What a page has once, or not at all, of what each SVG file has.
_NOT_EMBEDDED = re.compile(r'<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->', re.S)


class Embedded(NamedTuple):
    """A figure for a page that needs no other file.

    Attributes:
        name: Name of its files, without an ending.
        caption: What it shows.
        drawing: An `svg` element, '' for a picture.
        picture: Address of a picture, '' for a drawing.
        still: Address of a still of a moving picture, '' for none.
        width_px: Width that it is drawn for, in the page's pixels; 0 for a picture.
    """

    name: str
    caption: str
    drawing: str = ''
    picture: str = ''
    still: str = ''
    width_px: int = 0


def embedded(caption: str, files: Sequence[Path]) -> Embedded:
    """Return a figure for a page: its drawing where it has one, and otherwise its picture.

    Args:
        caption: What it shows.
        files: Files of the figure, with one name and several endings; an animation has a still
            picture, too.
    """
    name = files[0].stem
    drawing = next((file for file in files if file.suffix == '.svg'), None)
    if drawing is not None:
        text = drawing.read_text('utf-8')
        return Embedded(name, caption, svg_element(text, name), width_px=_width_px(text))
    still = files[0].with_suffix('.png') if files[0].suffix == '.webp' else None
    return Embedded(
        name, caption, picture=_data(files[0]), still='' if still is None else _data(still)
    )


def svg_element(text: str, name: str) -> str:
    """Return the `svg` element of a file of matplotlib's, for an HTML page with others.

    Args:
        text: What the file says.
        name: Is put before its identifiers, of which each may be on a page once.
    """
    drawing = _NOT_EMBEDDED.sub('', text[text.index('<svg') :])
    drawing = re.sub(r'\bid="', f'id="{name}-', drawing)
    drawing = re.sub(r'(href="|url\()#', rf'\1#{name}-', drawing)
    head, end, rest = drawing.partition('>')
    head = re.sub(r'\s(?:xmlns(?::\w+)?|version|width|height)="[^"]*"', '', head)
    drawing = f'{head}{end}{rest}'
    return re.sub(r'\s*\n\s*', '\n', drawing).strip()


def _width_px(text: str) -> int:
    """Return a drawing's width; its files have it in points."""
    found = re.search(r'\bwidth="([\d.]+)pt"', text)
    return round(float(found[1]) * 96 / 72) if found else 0


def _data(file: Path) -> str:
    content = base64.b64encode(file.read_bytes()).decode('ascii')
    return f'data:{_KINDS[file.suffix]};base64,{content}'
