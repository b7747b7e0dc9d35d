"""A lap as an animation: the camera's events next to the course.

An animated WebP, which browsers play and README pages show; the same drive gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
import io
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spikelane.figures.course_map import draw_course
from spikelane.runs.lap.trajectory import Trajectory
from spikelane_sim import figure_style as style
from spikelane_sim.course import Course
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.events import Events
from spikelane_sim.files import write_bytes_atomically

if TYPE_CHECKING:
    from PIL import Image
    from PIL.ImageFont import FreeTypeFont

#: Pictures of an animation, and how long each is shown.
FRAMES = 120
FRAME_MS = 80

_SIZE_PX = (640, 360)
_DPI = 100
_MAP = (0.48, 0.02, 0.51, 0.86)  # of the picture: left, bottom, width, height
_SENSOR_PX = (16, 52, 288)  # left, top, side
_SHOWN_STEPS = 10  # whose events a picture has
_TEXT_PX = 13
_ROBOT_PX = 5


class _Scene(NamedTuple):
    """What all pictures share."""

    background: Image.Image
    path_px: NDArray[np.float64]  # of the robot, (n, 2)
    font: FreeTypeFont


def draw_animation(
    trajectory: Trajectory,
    events: Sequence[Events],
    image_size: tuple[int, int],
    course: Course,
    path: Path,
    title: str = '',
) -> Path:
    """Draw a drive as an animation, and its middle picture as a still image next to it.

    Args:
        trajectory: Trajectory of one episode, (n,).
        events: Events of each of its observations, n arrays.
        image_size: Width and height of the camera's image [px].
        course: What it was driven on.
        path: Ending in .webp; the still ends in .png.
        title: Above the picture.

    Returns:
        The animation.

    Raises:
        SpikelaneError: There are not as many arrays as observations.
        FileError: It cannot be written.
    """
    if len(events) != len(trajectory):
        raise SpikelaneError(
            f'animation: expected the events of {len(trajectory)} observations, got {len(events)}'
        )
    scene = _scene(trajectory, course, title)
    rows = np.unique(np.linspace(0, len(trajectory) - 1, FRAMES).round().astype(int)).tolist()
    pictures = []
    for row in rows:
        shown = _event_pixels(events[max(0, row - _SHOWN_STEPS + 1) : row + 1], image_size)
        pictures.append(_picture(scene, trajectory, shown, row))
    write_bytes_atomically(path, _encoded(pictures))
    still = io.BytesIO()
    pictures[len(pictures) // 2].save(still, 'png')
    write_bytes_atomically(path.with_suffix('.png'), still.getvalue())
    return path


def _scene(trajectory: Trajectory, course: Course, title: str) -> _Scene:
    from matplotlib import font_manager
    from PIL import Image, ImageFont

    width, height = _SIZE_PX
    with style.settings():
        figure = style.new_figure(width / _DPI, height / _DPI)
        figure.set_dpi(_DPI)
        axes = figure.add_axes(_MAP)
        draw_course(axes, course, course.lane(trajectory.lane))
        figure.text(0.025, 0.945, title, weight='bold', fontsize=11, va='center')
        canvas = figure.canvas
        canvas.draw()
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[attr-defined]
        points = np.stack([trajectory.x_m, trajectory.y_m], axis=-1)
        path_px = axes.transData.transform(points)
    path_px[:, 1] = height - path_px[:, 1]  # pictures count rows from the top
    font = ImageFont.truetype(font_manager.findfont('DejaVu Sans'), _TEXT_PX)
    return _Scene(Image.fromarray(pixels).convert('RGB'), path_px, font)


def _picture(
    scene: _Scene, trajectory: Trajectory, events: NDArray[np.uint8], row: int
) -> Image.Image:
    from PIL import Image, ImageDraw

    picture = scene.background.copy()
    left, top, side = _SENSOR_PX
    height, width = events.shape[:2]
    scale = side / max(width, height)
    width, height = round(width * scale), round(height * scale)
    picture.paste(
        Image.fromarray(events).resize((width, height), Image.Resampling.NEAREST), (left, top)
    )
    pen = ImageDraw.Draw(picture)
    pen.rectangle((left - 1, top - 1, left + width, top + height), outline=style.PALE_INK)
    driven = [tuple(point) for point in scene.path_px[: row + 1].tolist()]
    if len(driven) > 1:
        pen.line(driven, fill=style.RIGHT, width=2)
    x, y = driven[-1]
    pen.ellipse((x - _ROBOT_PX, y - _ROBOT_PX, x + _ROBOT_PX, y + _ROBOT_PX), fill=style.LEFT)
    state = (
        f'{row * trajectory.period_s:6.1f} s    d = {1000 * trajectory.distance_m[row]:+.0f} mm'
    )
    seen = f'events of {_SHOWN_STEPS * trajectory.period_s:g} s: brighter blue, darker orange'
    pen.text((left, top - 18), state, fill=style.INK, font=scene.font)
    pen.text((left, top + height + 3), seen, fill=style.INK, font=scene.font.font_variant(size=11))
    return picture


def _event_pixels(steps: Sequence[Events], image_size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the events of some steps as an image of the sensor, (height, width, 3)."""
    from PIL import ImageColor

    width, height = image_size
    pixels = np.full((height, width, 3), 255, np.uint8)
    for events in steps:
        for polarity, colour in ((1, style.RIGHT), (-1, style.LEFT)):
            chosen = events[events['polarity'] == polarity]
            pixels[chosen['y'], chosen['x']] = ImageColor.getrgb(colour)
    return pixels


def _encoded(pictures: Sequence[Image.Image]) -> bytes:
    buffer = io.BytesIO()
    pictures[0].save(
        buffer,
        'webp',
        save_all=True,
        append_images=pictures[1:],
        duration=FRAME_MS,
        loop=0,
        quality=60,
        method=2,
    )
    return buffer.getvalue()
