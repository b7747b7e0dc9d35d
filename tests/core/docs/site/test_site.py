"""The documentation site: Sphinx builds it without a warning, and what it shows."""

from __future__ import annotations

from html.parser import HTMLParser
import os
from pathlib import Path
import subprocess
import sys
from urllib.parse import unquote, urlsplit

from playwright.sync_api import sync_playwright
import pytest

ROOT = Path(__file__).parents[4]


class Page(HTMLParser):
    """What a page links to, and where it can be linked to."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.anchors: set[str] = set()
        self.feed(file.read_text('utf-8'))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note links, sources and anchors."""
        for name, value in attrs:
            if name in ('href', 'src') and value:
                self.targets.append(value)
            elif name == 'id' and value:
                self.anchors.add(value)


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site as `make docs` does, except that the notebooks are not run."""
    out = tmp_path_factory.mktemp('site')
    command = [sys.executable, '-m', 'sphinx', '-W', '--keep-going', '-q', '-c', 'docs/site']
    command += ['-d', str(out / 'doctrees'), '-D', 'nb_execution_mode=off', '.', str(out / 'html')]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (built.returncode, built.stderr) == (0, '')
    return out / 'html'


@pytest.fixture(scope='module')
def pages(site: Path) -> dict[str, Page]:
    """Read all pages, by their places in the site."""
    return {str(file.relative_to(site)): Page(file) for file in site.rglob('*.html')}


@pytest.mark.slow
def test_every_link_leads_somewhere_in_the_site(site: Path, pages: dict[str, Page]) -> None:
    """Links to pages, headings, pictures and files of the repository."""
    lost = []
    for name, page in pages.items():
        for target in page.targets:
            address = urlsplit(target)
            if address.scheme or address.netloc:
                continue
            path = os.path.normpath(os.path.join(os.path.dirname(name), unquote(address.path)))
            where = name if not address.path else path
            if not (site / where).is_file():
                lost.append(f'{name}: {target}')
            elif address.fragment and where in pages and name not in ('search.html',):
                anchor = unquote(address.fragment)
                if anchor not in pages[where].anchors:
                    lost.append(f'{name}: {target}')
    assert lost == []


def test_every_page_is_in_the_navigation(pages: dict[str, Page]) -> None:
    """Each is linked from the sidebar of the first page."""
    files = [
        ROOT / 'CHANGELOG.md',
        ROOT / 'CONTRIBUTING.md',
        ROOT / 'SECURITY.md',
        ROOT / 'controllers/README.md',
    ]
    files += (ROOT / 'docs').rglob('*.md')
    files += (ROOT / 'docs/notebooks').glob('*.ipynb')
    assert len(files) > 30
    expected = {str(file.relative_to(ROOT).with_suffix('.html')) for file in files}
    assert expected - set(pages['README.html'].targets) == set()


@pytest.mark.parametrize(
    ('page', 'anchor'),
    [
        ('docs/api/python.html', 'spikelane.make_controller'),
        ('docs/api/python.html', 'spikelane.drive'),
        ('docs/api/python.html', 'spikelane.train'),
        ('docs/api/python.html', 'spikelane.evaluate'),
        ('docs/api/python.html', 'spikelane.load_run'),
        ('docs/api/python.html', 'spikelane.Run.trajectory'),
        ('docs/api/gymnasium.html', 'spikelane_sim.env.LaneKeepingEnv.step'),
        ('docs/api/controllers.html', 'spikelane_controllers.card.ControllerCard'),
        ('docs/api/controllers.html', 'spikelane_sim.contract.LaneState.distance_m'),
        ('docs/api/simulator.html', 'spikelane_sim.engine.Engine'),
        ('docs/api/simulator.html', 'spikelane_sim.robots.model.RobotModel'),
        ('docs/api/simulator.html', 'spikelane_sim.pixels.PixelModel.step'),
        ('docs/api/simulator.html', 'spikelane_sim.filters.kind.EventFilter.passes'),
    ],
)
def test_the_api_pages_have_what_is_public(pages: dict[str, Page], page: str, anchor: str) -> None:
    """With an anchor to link to."""
    assert anchor in pages[page].anchors


def test_comments_after_fields_are_shown(site: Path) -> None:
    """The fields of a named tuple are explained in comments in the code."""
    text = (site / 'docs/api/controllers.html').read_text('utf-8')
    assert 'right of it positive' in text
    assert 'Alias for field number' not in text


def test_files_of_the_repository_are_shown(site: Path) -> None:
    """Where pages link to them; folders list what Git has in them."""
    text = (site / 'source/docs/examples/stable_baselines.py.html').read_text('utf-8')
    assert 'class="highlight"' in text
    text = (site / 'source/docs/examples/balance.html').read_text('utf-8')
    assert 'href="balance/my_controllers/cards.py.html"' in text
    assert 'pycache' not in text


@pytest.mark.parametrize('width_px', [1280, 390])
def test_pages_are_no_wider_than_the_window(site: Path, chromium: str, width_px: int) -> None:
    """On a laptop and on a phone: wide tables and code scroll inside their frames."""
    pages = ('README', 'docs/api/python', 'docs/reference/simulator', 'docs/results/rstdp')
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=['--no-sandbox'])
        page = browser.new_page(viewport={'width': width_px, 'height': 900})
        page.goto((site / 'index.html').as_uri())
        page.wait_for_url('**/README.html')
        widths = []
        for name in pages:
            page.goto((site / f'{name}.html').as_uri())
            widths.append(page.evaluate('document.documentElement.scrollWidth'))
    assert widths == [width_px] * len(pages)
