"""The report on tiny real runs: one file, well-formed, that needs nothing from elsewhere."""

from __future__ import annotations

import argparse
import base64
from collections.abc import Iterator
import io
import json
from pathlib import Path
import re
import shlex
import signal
from typing import Any

import html5lib
import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright
import pytest
import yaml

from spikelane.main import run
from spikelane.report.again import drive_again
from spikelane.report.collect import collect
from spikelane.runs.arguments import given_parameters
from spikelane.runs.configuration import Request
from spikelane.runs.folder import versions
from spikelane.runs.lap.trajectory import read_csv, write_csv
from spikelane.runs.train import command as train
from spikelane.runs.train.config import TrainConfig
from spikelane_sim.errors import SpikelaneError

# Seconds of work for one who has the machine for himself.
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

NO_RUN = 'the folders that the report was given contain no such run'
SHORT = ('--robot', 'kinematic', '--seed', '1', '--json')

#: Run in the page: says what is found there.
PROBE = """() => {
  const images = [...document.images];
  return {
    width: document.documentElement.scrollWidth,
    inner: innerWidth,
    broken: images.filter(image => !image.complete || !image.naturalWidth).length,
    images: images.length,
    loaded: performance.getEntriesByType('resource')
      .map(entry => entry.name).filter(name => !name.startsWith('data:')),
    dark: matchMedia('(prefers-color-scheme: dark)').matches,
    paper: getComputedStyle(document.body).backgroundColor,
    cells: [...document.querySelectorAll('table.all td')].map(cell => cell.textContent),
    drawings: document.querySelectorAll('figure svg').length,
    grounds: [...new Set([...document.querySelectorAll('figure svg')].map(
      drawing => getComputedStyle(drawing.querySelector('path')).fill))],
    wide: [...document.querySelectorAll('table')].filter(
      table => table.scrollWidth > table.parentNode.clientWidth).length,
  };
}"""


@pytest.fixture(scope='module')
def report(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Drive, evaluate and train a little, and report on it, by the commands."""
    before = signal.getsignal(signal.SIGTERM)
    runs = tmp_path_factory.mktemp('runs')
    short = (*SHORT, '--param', 'simulator.episode.max_steps=80')
    always = ('--transport', 'inprocess')
    assert run(['lap', *short, *always, '--out', str(runs / 'lap')]) == 1  # not completed
    assert run(['evaluate', *short, '--seeds', '2', '--out', str(runs / 'deep/evaluation')]) == 0
    assert run(['train', 'rstdp', *SHORT, '--steps', '900', '--out', str(runs / 'rstdp')]) == 0
    assert run(['train', 'dqn', *SHORT, '--steps', '120', '--out', str(runs / 'dqn')]) == 0
    few = ('--states', '300', '--steps', '60', '--checkpoint', str(runs / 'dqn'))
    assert run(['transfer', *SHORT, *few, '--out', str(runs / 'transfer')]) == 0
    (runs / 'unfinished').mkdir()
    (runs / 'unfinished/config.yaml').write_text('lane: outer\n')
    output = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('sys.stdout', output)
        assert run(['report', str(runs), '--out', str(runs / 'report'), '--json']) == 0
    yield {**json.loads(output.getvalue()), 'folder': runs}
    signal.signal(signal.SIGTERM, before)


def page_of(report: dict[str, Any]) -> str:
    """Return the page."""
    return Path(report['page']).read_text('utf-8')


def attributes(page: str) -> list[tuple[str, str]]:
    """Return all attributes of the page's elements; the page must be well-formed."""
    root = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(page)
    return [pair for element in root.iter() for pair in element.attrib.items()]


def decoded(page: str) -> list[tuple[str, bytes]]:
    """Return kind and content of everything embedded in the page."""
    sources = [value for name, value in attributes(page) if name in ('src', 'srcset')]
    found = [re.fullmatch(r'data:(image/[a-z+]+);base64,(\S+)', each) for each in sources]
    assert all(found)
    return [(each[1], base64.b64decode(each[2])) for each in found if each]


def test_the_page_holds_all_and_asks_for_nothing(report: dict[str, Any]) -> None:
    """Well-formed; images are embedded, no style, script or image is from elsewhere."""
    page = page_of(report)
    assert not {name for name, _ in attributes(page)} & {'href', 'action', 'data', 'poster'}
    assert 'http:' not in page
    assert 'https:' not in page
    assert not re.search(r'@import|url\((?!#)|<script[^>]|<link', page)
    drawings = re.findall(r'<svg.*?</svg>', page, re.S)
    identifiers = re.findall(r'\sid="([^"]*)"', page)
    assert len(set(identifiers)) == len(identifiers)
    for drawing in drawings:
        links = re.findall(r'href="([^"]*)"', drawing)
        assert all(link.startswith(('#', 'data:')) for link in links)
        assert {link[1:] for link in links if link[0] == '#'} <= set(identifiers)
    for kind, content in decoded(page):
        assert kind in ('image/png', 'image/webp')
        assert Image.open(io.BytesIO(content)).format in ('PNG', 'WEBP')


def test_the_page_has_the_tables_rows(report: dict[str, Any]) -> None:
    """The cells of the tables, in their order; report.json has the same."""
    root = html5lib.parse(page_of(report), namespaceHTMLElements=False)
    tables = [each for each in root.iter('table') if each.get('class') == 'all']
    rows = [
        tuple(cell[0].text for cell in row.iter('td'))
        for each in tables
        for row in each.iter('tr')
    ]
    rows = [row for row in rows if row]
    assert rows == [tuple(row) for table in report['tables'] for row in table['rows']]
    numbers = json.loads(Path(report['page']).with_name('report.json').read_text())
    assert numbers['tables'] == report['tables']
    assert (
        'Braitenberg',
        '1',
        'setting 1',
        'inner',
        '0 of 2 (0% to 66%)',
        'none',
        '—',
        'none',
        '—',
        'none',
        '2 seeds',
        '1 to 2',
    ) in rows


def test_every_figure_is_drawn_and_what_is_missing_named(report: dict[str, Any]) -> None:
    """Named by what it shows, as PNG and SVG; the animation as WebP."""
    names = {Path(file).name for file in report['figures']}
    both = {
        'scenarios',
        'dqn_reward',
        'rstdp_reward',
        'state_input',
        'dqn_scenario_1_robot_engine_kinematic_episodes',
        'dqn_scenario_1_robot_engine_kinematic_state_images',
        'transfer_scenario_1_setting_1_accuracy',
        'transfer_scenario_1_setting_1_rates',
        'rstdp_scenario_1_robot_engine_kinematic_weights',
        'rstdp_scenario_1_robot_engine_kinematic_terminations',
        'braitenberg_weights',
        'deviation_scenario_1',
        'deviation_scenario_1_inner',
        'training_time',
    }
    assert names == {f'{name}.{kind}' for name in both for kind in ('svg', 'png')} | {
        'animation.webp'
    }
    assert all(Path(file).stat().st_size for file in report['figures'])
    left_out = {each['what']: each['why'] for each in report['left_out']}
    assert (
        left_out[str(report['folder'] / 'unfinished')]
        == 'the run has not finished: metrics.json is missing'
    )
    assert left_out['R-STDP training, scenario 3'] == NO_RUN
    # The lap is the one that the evaluation drove with the same seed.
    assert left_out[str(report['folder'] / 'lap')].startswith('it is a copy of ')
    assert 'R-STDP training, scenario 1' not in left_out
    assert all(each in page_of(report) for each in ('R-STDP training, scenario 3', 'unfinished'))


def test_each_row_has_its_command(report: dict[str, Any]) -> None:
    """An evaluation has one command for all its laps, on the page and in the JSON."""
    groups = {each['what'].partition(':')[0]: each['lines'] for each in report['commands']}
    [lap], runs = groups['Laps'], report['folder']
    assert lap == (
        './spikelane evaluate --scenario 1 --seed 1 --controller braitenberg --seeds 2 '
        '--transport inprocess --param simulator.episode.max_steps=80 --robot kinematic'
    )
    [transfer] = groups['Transfers']
    assert transfer == (
        './spikelane transfer --scenario 1 --seed 1 --controller dqn_snn '
        f'--checkpoint {runs}/dqn --from-training --param gathering.states=300 '
        '--param transfer.steps=60 --robot kinematic '
        f'--out {runs}/transfer'
    )
    root = html5lib.parse(page_of(report), namespaceHTMLElements=False)
    shown = [line for each in root.iter('pre') for line in each.text.split('\n') if line]
    assert shown == [line for each in report['commands'] for line in each['lines']]


def test_the_commands_give_the_same_configurations(report: dict[str, Any]) -> None:
    """Read by the commands themselves, they determine what the runs' folders say."""
    trainings = [
        (line, Path(shlex.split(line)[-1]))
        for each in report['commands']
        for line in each['lines']
        if each['what'].startswith('Trainings')
    ]
    assert len(trainings) == 2
    for line, folder in trainings:
        parser = argparse.ArgumentParser()
        train.add_arguments(parser)
        options = parser.parse_args(shlex.split(line)[2:])
        config = TrainConfig.make(
            Request(
                options.scenario,
                options.controller,
                options.seed,
                options.transport,
                given_parameters(options),
            ),
            options.steps,
        )
        written = yaml.safe_load((folder / 'config.yaml').read_text())
        for name in ('given', 'command_line', 'versions'):
            written.pop(name)
        assert json.loads(json.dumps(config.to_dict())) == written


def test_the_tables_are_there_in_markdown(report: dict[str, Any]) -> None:
    """Each under its title, with as many rows as in the JSON."""
    text = Path(report['page']).with_name('report.md').read_text('utf-8')
    titles = [line[3:] for line in text.split('\n') if line.startswith('## ')]
    assert titles == [table['title'] for table in report['tables']]
    rows = [line for line in text.split('\n') if line.startswith('| ')]
    assert len(rows) == sum(2 + len(table['rows']) for table in report['tables'])
    assert f'7 runs at commit {versions()["commit"] or "not recorded"}: ' in text


def test_it_is_told_what_made_the_runs(report: dict[str, Any]) -> None:
    """All with this commit, on this machine."""
    [made] = report['made_with']
    # An evaluation's four laps, two trainings and a transfer.
    assert made['runs'] == 7
    assert made['commit'] == (versions()['commit'] or 'not recorded')
    assert made['machine'] == versions()['machine']
    assert f'numpy {np.__version__}' in made['versions']
    assert f'This page: commit {made["commit"]}; machine: {made["machine"]}' in page_of(report)


def test_the_animation_moves(report: dict[str, Any]) -> None:
    """A picture a step of these 81, none like the one before; small."""
    [file] = [file for file in report['figures'] if file.endswith('.webp')]
    with Image.open(file) as animation:
        assert (animation.n_frames, animation.size) == (81, (640, 360))
        pictures = []
        for frame in (0, 40, 80):
            animation.seek(frame)
            pictures.append(np.asarray(animation.convert('RGB')))
    assert (pictures[0] != pictures[1]).any()
    assert (pictures[1] != pictures[2]).any()
    assert Path(file).stat().st_size < 1_000_000


def test_the_same_runs_give_the_same_page(report: dict[str, Any], tmp_path: Path) -> None:
    """To the last byte."""
    assert run(['report', str(report['folder']), '--out', str(tmp_path), '--json']) == 0
    assert (tmp_path / 'report.html').read_text('utf-8') == page_of(report)


def test_a_lap_driven_again_is_checked(report: dict[str, Any], tmp_path: Path) -> None:
    """What the camera saw has as many events as recorded; another drive is refused."""
    [lap] = collect([report['folder'] / 'lap']).laps
    trajectory = read_csv(lap.folder / 'trajectory.csv')
    seen = drive_again(lap, trajectory)
    assert [len(events) for events in seen.events] == trajectory.events.tolist()
    trajectory.left_rad_s[10] += 0.5
    write_csv(trajectory, tmp_path / 'other.csv')
    with pytest.raises(SpikelaneError, match='expected step 11 to be the same again'):
        drive_again(lap, read_csv(tmp_path / 'other.csv'))


def test_nothing_to_report_on_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the status of wrong use."""
    before = signal.getsignal(signal.SIGTERM)
    assert run(['report', str(tmp_path / 'none')]) == 2
    signal.signal(signal.SIGTERM, before)
    error = capsys.readouterr().err
    assert error == f'spikelane report: {tmp_path}/none: expected a folder of runs, got none\n'


@pytest.mark.parametrize('width', [1280, 390])
@pytest.mark.parametrize(
    ('scheme', 'paper'), [('light', 'rgb(255, 255, 255)'), ('dark', 'rgb(20, 24, 28)')]
)
def test_a_browser_shows_it_on_a_screen_and_on_a_phone(
    report: dict[str, Any], tmp_path: Path, chromium: str, scheme: str, paper: str, width: int
) -> None:
    """In light and in dark: tables fit, every picture is there, nothing is loaded."""
    (tmp_path / 'page.html').write_text(page_of(report), 'utf-8')
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=['--no-sandbox'])
        page = browser.new_page(viewport={'width': width, 'height': 844}, color_scheme=scheme)
        page.goto((tmp_path / 'page.html').as_uri())
        page.evaluate('for (const each of document.querySelectorAll("details")) each.open = true')
        found = page.evaluate(PROBE)
        browser.close()
    assert found['width'] <= found['inner'] <= width
    assert found['wide'] == 0
    assert (found['broken'], found['images'], found['drawings']) == (0, 1, 14)
    assert found['grounds'] == [paper]
    assert found['loaded'] == []
    assert (found['dark'], found['paper']) == (scheme == 'dark', paper)
    cells = [cell for table in report['tables'] for row in table['rows'] for cell in row]
    assert found['cells'] == cells


def test_a_pointer_is_told_the_values(
    report: dict[str, Any], tmp_path: Path, chromium: str
) -> None:
    """Half way along the lane of the first drive, from the drive's own rows."""
    (tmp_path / 'page.html').write_text(page_of(report), 'utf-8')
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=['--no-sandbox'])
        page = browser.new_page(viewport={'width': 1280, 'height': 900})
        page.goto((tmp_path / 'page.html').as_uri())
        part = page.locator('#deviation_scenario_1 .values rect').first
        part.hover()
        told, shown = page.locator('#told').text_content(), page.locator('#told').is_visible()
        page.mouse.move(1, 1)
        gone = page.locator('#told').is_hidden()
        browser.close()
    [lap] = [
        each
        for each in collect([report['folder'] / 'deep']).laps
        if each.lane == 'outer' and each.seed == 1
    ]
    trajectory = read_csv(lap.folder / 'trajectory.csv')
    low_m, high_m, mean_m, most_m = map(float, re.findall(r'[-+]?\d+\.\d+', told or ''))
    driven = (trajectory.position_m[1:] >= low_m) & (trajectory.position_m[1:] < high_m)
    assert driven.any()
    assert mean_m == pytest.approx(trajectory.distance_m[1:][driven].mean(), abs=0.002)
    assert abs(most_m) >= abs(mean_m)
    assert (shown, gone) == (True, True)


def test_a_lap_of_another_camera_is_shown(tmp_path: Path) -> None:
    """Its animation has the camera's shape; the paper's state images are of another size."""
    parameters = (
        'simulator.camera.width=160',
        'rstdp.encoding.width=160',
        "rstdp.checkpoint=''",
        'simulator.episode.max_steps=20',
    )
    words = ['--controller', 'rstdp', '--transport', 'inprocess']
    words += [word for parameter in parameters for word in ('--param', parameter)]
    assert run(['lap', *SHORT, *words, '--out', str(tmp_path / 'lap')]) == 1  # not completed
    assert run(['report', str(tmp_path), '--out', str(tmp_path / 'report'), '--json']) == 0
    result = json.loads((tmp_path / 'report/report.json').read_text('utf-8'))
    why = {each['what'].partition(':')[0]: each['why'] for each in result['left_out']}
    assert why['State input, half way'] == (
        'state input: expected a camera of 128 x 128 px, got 160 x 128 px'
    )
    with Image.open(tmp_path / 'report/figures/animation.png') as picture:
        shown = np.asarray(picture.convert('RGB')).astype(int)
    coloured = (shown.max(axis=2) - shown.min(axis=2))[52:340, 16:304] > 60  # the events' place
    assert coloured.any()
    assert not coloured[round(288 * 128 / 160) + 1 :].any()
