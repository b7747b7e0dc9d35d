"""Course files that are accepted, and all the ways in which one is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from spikelane_sim.course import load_course
from spikelane_sim.errors import CourseError

# A stadium: two straights of 4 m and two half circles of 2 m.
STADIUM = """\
name: stadium
road_width: 1.0
lane_width: 0.5
centre_line:
  start: {x: 0, y: 0, heading_deg: 0}
  parts:
    - {section: A, straight: 4}
    - {section: B, arc: {radius: 2, angle_deg: 180}}
    - {section: C, straight: 4.0}
    - {section: D, arc: {radius: 2.0, angle_deg: 180.0}}
lanes:
  right: {offset: 0.25, direction: along, start: {position: 1}}
  left:
    {offset: -0.25, direction: against, first_section: C, start: {x: 1, y: 3.8, heading_deg: 5}}
markings:
  - {offset: 0.0, width: 0.1, style: dashed, dash: 1, gap: 1, phase: 0.5}
"""


def load(tmp_path: Path, text: str, name: str = 'course.yaml') -> str:
    """Write a course file, load it and return the error's message."""
    path = tmp_path / name
    path.write_text(text, 'utf-8')
    with pytest.raises(CourseError) as error:
        load_course(str(path))
    message = str(error.value)
    assert message.startswith(str(path))
    assert '\n' not in message
    return message[len(str(path)) :]


def test_a_user_s_course_needs_no_code(tmp_path: Path) -> None:
    """A fourth course: lanes, start poses, phase and default intensities."""
    path = tmp_path / 'stadium.yaml'
    path.write_text(STADIUM)
    course = load_course(str(path))
    assert (course.name, list(course.lanes)) == ('stadium', ['right', 'left'])
    assert course.lanes['right'].length_m == pytest.approx(8 + 2 * math.pi * 2.25)
    assert course.lanes['right'].start == pytest.approx((1.0, -0.25, 0.0))
    assert course.lanes['left'].start == pytest.approx((1.0, 3.8, math.radians(5)))
    left = course.lanes['left'].sections
    assert [section.name for section in left] == ['C', 'B', 'A', 'D']
    # Against the chain C is driven to the right, from x = 0, along y = 3.75.
    assert course.locate('left', 1.0, 3.7, 0.0)[:3] == pytest.approx((0.05, 0.0, 1.0))
    assert course.intensity([0.49, 0.51, 1.49, 1.51, 2.51], 0.0).tolist() == [0, 1, 1, 0, 1]


def test_a_marking_may_run_over_the_chain_s_end(tmp_path: Path) -> None:
    """A range that ends before it begins; numbers as YAML 1.1 does not know them."""
    path = tmp_path / 'stadium.yaml'
    line = '{offset: 5e-1, width: 1e-1, style: solid, ranges: [[20.0, 1], [2, 3]]}'
    path.write_text(f'{STADIUM}  - {line}\nfloor_intensity: 0.25\nmarking_intensity: 0.75\n')
    course = load_course(str(path))
    assert course.intensity([-0.2, 0.5, 1.5, 2.5, 3.5], -0.5).tolist() == [
        *(0.75, 0.75, 0.25, 0.75, 0.25)
    ]


def test_a_circle_is_a_course(tmp_path: Path) -> None:
    """One arc of 360 degrees closes and does not count as overlapping."""
    head, tail = STADIUM.split('    - {section: A')[0], STADIUM[STADIUM.index('lanes:') :]
    tail = tail.replace(
        'first_section: C, start: {x: 1, y: 3.8, heading_deg: 5}', 'start: {position: 0}'
    )
    path = tmp_path / 'circle.yaml'
    path.write_text(f'{head}    - {{section: A, arc: {{radius: 3, angle_deg: -360}}}}\n{tail}')
    course = load_course(str(path))
    assert course.lanes['right'].length_m == pytest.approx(2 * math.pi * 2.75)
    assert course.locate('right', 0.0, -5.0, math.pi).distance_m == pytest.approx(0.75)


# What is replaced in the stadium's text, by what, and the message after the file's name.
WRONG = [
    (
        'straight: 4}',
        'straight: 5}',
        ': centre_line: expected an end that meets its start to 1e-06 m and rad, got '
        'a gap of 1 m and 0 rad (the chain ends at (1.000000, 0.000000) m, '
        '360.000000 deg)',
    ),
    ('radius: 2, angle_deg: 180', 'radius: 2, angle_deg: 170', 'rad (the chain ends at'),
    ('radius: 2,', 'radius: 0.4,', 'an end that meets its start'),
    (
        '{radius: 2, angle_deg: 180}',
        '{radius: 2, angle_deg: 0}',
        ':8: centre_line.parts[1].arc.angle_deg: expected an angle of at least 0.01 '
        "to either side, got '0'",
    ),
    (
        'radius: 2,',
        'radius: -2,',
        ":8: centre_line.parts[1].arc.radius: expected a number from 0.001 to 1000, got '-2'",
    ),
    ('radius: 2,', 'radius: .inf,', 'expected a number from 0.001 to 1000'),
    ('radius: 2,', 'radius: nan,', 'expected a number from 0.001 to 1000'),
    ('radius: 2,', 'radius: "2",', 'expected a number from 0.001 to 1000'),
    ('radius: 2,', 'radius: [2],', 'expected a number from 0.001 to 1000, got a list'),
    ('radius: 2,', 'radius: ,', 'got nothing'),
    ('radius: 2,', 'radius: true,', "got 'true'"),
    (
        'road_width: 1.0',
        'road_width: 1.0\nroad_widht: 1.0',
        ":3: unknown key 'road_widht', expected name, road_width",
    ),
    (
        'section: A, straight: 4}',
        'section: A, straigth: 4}',
        ":7: unknown key 'straigth' of centre_line.parts[0], expected section, straight, arc",
    ),
    (
        'section: A, straight: 4}',
        'section: A}',
        "centre_line.parts[0]: expected either 'straight' or 'arc', got a mapping",
    ),
    ('road_width: 1.0\n', '', "expected the key 'road_width'"),
    ('road_width: 1.0\n', 'road_width: 1.0\nroad_width: 1.0\n', ':3: road_width: given twice'),
    ('name: stadium', 'name: 7', ":1: name: expected a text, got '7'"),
    ('name: stadium', 'name: ""', ':1: name: expected a text, got nothing'),
    (
        'direction: along',
        'direction: forward',
        ":12: lanes.right.direction: expected along or against, got 'forward'",
    ),
    (
        'first_section: C',
        'first_section: G',
        ": lanes.left.first_section: expected D, C, B, A, got 'G'",
    ),
    (
        'position: 1}',
        'position: 23}',
        ': lanes.right.start: expected a position below 22.137 m, got 23 m',
    ),
    (
        'y: 3.8',
        'y: 4.3',
        ': lanes.left.start: expected a pose on the lane, facing along it, got one '
        '0.550 m from its centre, turned 5 deg',
    ),
    ('heading_deg: 5', 'heading_deg: 175', 'turned 175 deg'),
    (
        'offset: 0.25',
        'offset: 0.3',
        ': lanes.right.offset: expected a lane within the road (0.5 m to either '
        'side), got 0.5 m of width at 0.3 m',
    ),
    (
        'road_width: 1.0',
        'road_width: 4.2',
        ': centre_line.parts[1] (section B): expected a radius of more than 2.15 m, '
        'half of the road and its markings, got 2 m: too tight',
    ),
    (
        'offset: 0.0,',
        'offset: 0.6,',
        ': markings[0].offset: expected at most 0.5 m to either side, half of '
        'road_width, got 0.6 m',
    ),
    (
        'phase: 0.5',
        'ranges: [[0, 30]]',
        ': markings[0].ranges: expected arc lengths from 0 to 20.5664 m, got [0, 30]',
    ),
    (
        'phase: 0.5',
        'ranges: [[1, 1]]',
        ':16: markings[0].ranges[0]: expected two different arc lengths, from and to, got a list',
    ),
    ('phase: 0.5', 'ranges: [[1]]', 'expected a list of two arc lengths'),
    (', gap: 1', '', "markings[0]: expected the key 'gap'"),
    ('style: dashed', 'style: solid', "unknown key 'dash'"),
    ('style: dashed', 'style: dotted', "expected solid or dashed, got 'dotted'"),
    ('name: stadium', 'name: [', 'not YAML'),
    ('name: stadium', '---\n---\n', ':2: not YAML: but found another document'),
    ('name: stadium', 'name: !!python/object/apply:os.getcwd []', 'expected a text, got a list'),
    (
        'name: stadium',
        'name: stadium\nmarking_intensity: 1.5',
        'marking_intensity: expected a number from 0 to 1',
    ),
]


@pytest.mark.parametrize(('right', 'wrong', 'reason'), WRONG)
def test_a_wrong_file_is_refused_with_the_reason(
    tmp_path: Path, right: str, wrong: str, reason: str
) -> None:
    """Message: file, line where there is one, the thing, what was expected and what came."""
    assert STADIUM.count(right) >= 1
    assert reason in load(tmp_path, STADIUM.replace(right, wrong, 1))


def test_a_course_without_lanes_or_parts_is_refused(tmp_path: Path) -> None:
    """Both are needed."""
    head, rest = STADIUM.split('lanes:\n')
    markings = rest[rest.index('markings:') :]
    assert 'lanes: expected at least one lane' in load(tmp_path, f'{head}lanes: {{}}\n{markings}')
    start = STADIUM[: STADIUM.index('  parts:')]
    lanes = STADIUM[STADIUM.index('lanes:') :]
    assert 'at least one part' in load(tmp_path, f'{start}  parts: []\n{lanes}')


def test_a_lane_too_tight_for_its_width_is_refused(tmp_path: Path) -> None:
    """Half circles of 0.4 m leave the inner of two lanes of 0.5 m a radius of 0.15 m."""
    reason = load(
        tmp_path, STADIUM.replace('radius: 2.0', 'radius: 2').replace('radius: 2', 'radius: 0.4')
    )
    assert reason == (
        ": centre_line.parts[1] (section B): expected lane 'left' to turn with more than 0.25 m, "
        'got a radius of 0.15 m: too tight'
    )


# Two loops joined by two parallel straights that are WIDE - 1 m apart.
BONE = """\
    - {section: A, straight: 4}
    - {section: B, arc: {radius: 1, angle_deg: -60}}
    - {section: B, arc: {radius: WIDE, angle_deg: 300}}
    - {section: B, arc: {radius: 1, angle_deg: -60}}
    - {section: C, straight: 4}
    - {section: D, arc: {radius: 1, angle_deg: -60}}
    - {section: D, arc: {radius: WIDE, angle_deg: 300}}
    - {section: D, arc: {radius: 1, angle_deg: -60}}
"""


def test_a_road_that_overlaps_itself_is_refused(tmp_path: Path) -> None:
    """Straights 0.9 m apart on a road of 1 m; 1 m apart is just wide enough."""
    start, lanes = STADIUM[: STADIUM.index('    - {')], STADIUM[STADIUM.index('lanes:') :]
    lanes = lanes.replace('start: {x: 1, y: 3.8, heading_deg: 5}', 'start: {position: 0}')
    bone = f'{start}{BONE}{lanes}'
    reason = load(tmp_path, bone.replace('WIDE', '1.9'))
    assert reason.startswith(
        ': centre_line: expected parts of the road at least its width of 1 m apart, '
        'got an overlap: sections A and C come within 0.900 m'
    )
    path = tmp_path / 'wide.yaml'
    path.write_text(bone.replace('WIDE', '2.0'))
    assert load_course(str(path)).name == 'stadium'


def test_a_road_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    """A figure of eight closes, but there are no crossroads."""
    eight = """\
    - {section: A, straight: 8}
    - {section: B, arc: {radius: 4, angle_deg: 270}}
    - {section: C, straight: 8}
    - {section: D, arc: {radius: 4, angle_deg: -270}}
"""
    start, lanes = STADIUM[: STADIUM.index('    - {')], STADIUM[STADIUM.index('lanes:') :]
    reason = load(tmp_path, f'{start}{eight}{lanes}')
    assert 'got an overlap: sections A and C come within 0.' in reason


@pytest.mark.parametrize('text', ['', '# nothing\n', '- a\n', 'word', '{}', 'a: &a [*a]'])
def test_what_is_no_course_is_refused(tmp_path: Path, text: str) -> None:
    """Empty files, lists, words and several documents."""
    assert 'expected' in load(tmp_path, text)


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    """A name nobody knows, a folder, a file that is not text."""
    for name in ('scenario_4', str(tmp_path), str(tmp_path / 'absent.yaml'), ''):
        with pytest.raises(
            CourseError,
            match=r'expected scenario_1, .*, random:SEED or the path',
        ):
            load_course(name)
    path = tmp_path / 'binary.yaml'
    path.write_bytes(b'\xff\xfe\x00')
    with pytest.raises(CourseError, match='UTF-8'):
        load_course(str(path))
