"""`spikelane course`: what it says of a course, draws of it, and refuses."""

import json
import math
from pathlib import Path
import re

import pytest

from spikelane.main import run

PAGE = Path(__file__).parents[4] / 'docs' / 'courses.md'


@pytest.fixture
def oval(tmp_path: Path) -> Path:
    """Give the course file of the documentation's page."""
    [text] = re.findall(r'```yaml\n(.*?)```', PAGE.read_text(), re.DOTALL)
    file = tmp_path / 'oval.yaml'
    file.write_text(text)
    return file


def test_the_course_of_the_page_is_described(
    oval: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two straights of 4 m, two half turns of 2 m, and lanes 0.25 m to either side."""
    assert run(['course', str(oval), '--json']) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts['length_m'] == pytest.approx(8 + 4 * math.pi)
    assert facts['area_m'] == pytest.approx([-2.5, -0.5, 6.5, 4.5], abs=0.06)
    outer, inner = facts['lanes']['outer'], facts['lanes']['inner']
    assert outer['length_m'] == pytest.approx(8 + 4.5 * math.pi)
    assert inner['length_m'] == pytest.approx(8 + 3.5 * math.pi)
    assert (outer['direction'], inner['direction']) == ('along', 'against')
    assert outer['start'] == pytest.approx({'x_m': 0.5, 'y_m': -0.25, 'heading_deg': 0.0})
    assert [each['name'] for each in inner['sections']] == ['C', 'B', 'A', 'D']
    assert [each['turn'] for each in outer['sections']] == ['straight', 'left'] * 2
    assert [each['turn'] for each in inner['sections']] == ['straight', 'right'] * 2
    assert [each['radius_m'] for each in inner['sections']] == [None, 1.75, None, 1.75]


def test_its_figure_has_lanes_and_sections(
    oval: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both formats without an ending; the text names the files and the lanes."""
    assert run(['course', str(oval), '--figure', str(tmp_path / 'map')]) == 0
    text = capsys.readouterr().out
    assert 'oval: Two straights and two half turns' in text
    assert 'lane outer: 22.137 m long, driven along the chain, start (0.500, -0.250) m' in text
    for suffix in ('.svg', '.png'):
        assert f'figure: {tmp_path / "map"}{suffix}' in text
        assert (tmp_path / 'map').with_suffix(suffix).stat().st_size > 1000


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        ('straight: 4.0}\n    - {section: D', 'straight: 4.5}\n    - {section: D', 'a gap of 0.5'),
        ('radius: 2.0', 'radius: 0.5', 'a radius of 0.25 m: too tight'),
        ('style: solid', 'style: dotted', 'solid or dashed'),
    ],
)
def test_a_course_that_cannot_be_driven_is_refused(
    oval: Path, old: str, new: str, reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one line with exit status 2; no figure is written."""
    text = oval.read_text()
    assert old in text
    oval.write_text(text.replace(old, new))
    figure = oval.with_suffix('.png')
    assert run(['course', str(oval), '--figure', str(figure)]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f'spikelane course: {oval}')
    assert reason in line
    assert not figure.exists()
