"""What the documentation tells people to type, and where it sends them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import itertools
import os
from pathlib import Path
import re
import shlex
from typing import NamedTuple

import pytest
import yaml

from spikelane.executables import executables
from spikelane.experiment.file import read_experiment
from spikelane.main import _parser
from spikelane.runs.arguments import given_parameters, request_of
from spikelane.runs.configuration import configure
from spikelane_controllers import registry
from spikelane_sim.parameters import Parameters
from spikelane_sim.simulator_parameters import SimulatorParameters

ROOT = Path(__file__).parents[3]
PAGES = [
    ROOT / 'README.md',
    ROOT / 'CHANGELOG.md',
    ROOT / 'CONTRIBUTING.md',
    ROOT / 'SECURITY.md',
    ROOT / 'controllers/README.md',
    *sorted((ROOT / 'docs').rglob('*.md')),
]
EXPERIMENT = 'robustness.yaml'  # the one written out in the tutorial
#: Commands of others, that are taken as they are.
OTHERS = ({'cd', 'source', '.', 'colcon'}, {('ros2', 'bag'), ('python', '-m')})


class Line(NamedTuple):
    """A command in a page."""

    page: str
    words: tuple[str, ...]


def sh_lines(text: str) -> Iterator[str]:
    """Yield the lines of all sh blocks of a page."""
    for block in re.findall(r'^```sh\n(.*?)^```', text, re.M | re.S):
        yield from block.replace('\\\n', '').splitlines()


def commands() -> Iterator[Line]:
    """Yield the commands of all pages."""
    for page in PAGES:
        for line in sh_lines(page.read_text('utf-8')):
            words: list[str] = []
            for word in [*split(line), ';']:
                if word not in (';', '&&'):
                    words.append(word)
                elif words:
                    yield Line(str(page.relative_to(ROOT)), tuple(words))
                    words = []


def split(line: str) -> Iterator[str]:
    """Yield the words of a line as a shell has them, and what stands between commands."""
    words = shlex.shlex(line, posix=True, punctuation_chars=';&')
    words.whitespace_split = True
    yield from words


def called(line: Line) -> tuple[str, ...]:
    """Return the arguments of a `spikelane` command; none for another's."""
    if line.words[:4] == ('ros2', 'run', 'spikelane', 'spikelane'):
        return line.words[4:]
    return line.words[1:] if line.words[0].endswith('spikelane') else ()


COMMANDS = list(dict.fromkeys(commands()))
OURS = [line for line in COMMANDS if called(line)]


@pytest.fixture(autouse=True)
def _with_the_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Install the entry points of the examples of adding a controller."""
    folder = tmp_path / 'my_controllers-0.1.dist-info'
    folder.mkdir()
    (folder / 'METADATA').write_text('Metadata-Version: 2.1\nName: my_controllers\n')
    (folder / 'entry_points.txt').write_text(
        '[spikelane.controllers]\n'
        'balance = spikelane_controllers.braitenberg.controller:Braitenberg\n'
        'norse_lane = spikelane_controllers.braitenberg.controller:Braitenberg\n'
        'learning_balance = spikelane_controllers.rstdp.controller:RStdp\n'
        '[spikelane.trainings]\n'
        'learning_balance = spikelane_controllers.learning.training:Training\n'
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    registry._entries.cache_clear()
    yield
    registry._entries.cache_clear()


def named(line: Line) -> str:
    """Name a test by its command."""
    return ' '.join(line.words)


def reference(node: str, heading: str = '') -> set[str]:
    """Return what the reference lists of a node: names in its tables, of one heading or all."""
    text = (ROOT / f'docs/reference/{node}.md').read_text('utf-8')
    _, _, rest = text.partition(f'## {heading}')
    part = rest.partition('\n## ')[0] if heading else text
    return set(re.findall(r'^\| `(.+?)` ', part, re.M))


def check_node_arguments(node: str, arguments: Sequence[str]) -> None:
    """Check the parameters and remappings given to a node."""
    for flag, value in itertools.pairwise(arguments):
        if flag == '-p':
            assert value.partition(':=')[0] in reference(node, 'Parameters')
        if flag == '-r':
            assert value.partition(':=')[0] in reference(node)


def test_the_commands_are_found() -> None:
    """Otherwise the tests below would check nothing."""
    assert len(OURS) > 40
    assert {line.page for line in OURS} >= {
        'README.md',
        'docs/tutorial.md',
        'docs/add_a_controller.md',
    }


@pytest.mark.parametrize('line', OURS, ids=named)
def test_a_spikelane_command_is_understood(line: Line) -> None:
    """By its own parser; parameters are known and allowed, nodes and experiments there."""
    arguments = called(line)
    options = _parser(arguments).parse_args(arguments)
    assert options.command == arguments[0]
    if options.command == 'node':
        assert options.node in executables()
        check_node_arguments(options.node, options.arguments)
    if options.command == 'experiment' and options.file.name != EXPERIMENT:
        assert read_experiment(ROOT / options.file).blocks
    if getattr(options, 'controller', None) and hasattr(options, 'robot'):
        configure(request_of(options, given_parameters(options)), {})


def parameters_of(node: str) -> type[Parameters]:
    """Return the parameters of the simulator or of a controller."""
    if node == 'simulator':
        return SimulatorParameters
    return registry.controller_class(node).parameters_class


@pytest.mark.parametrize('line', [line for line in COMMANDS if line not in OURS], ids=named)
def test_another_command_is_about_what_there_is(line: Line) -> None:
    """Files, targets, nodes, launch files and their arguments."""
    first, *rest = line.words
    if first == 'make':
        assert f'\n{rest[0]}:' in (ROOT / 'Makefile').read_text('utf-8')
    elif first.endswith('pip'):
        for flag, value in itertools.pairwise(rest):
            assert flag not in ('-r', '-c') or (ROOT / value).exists()
    elif line.words[:2] == ('ros2', 'run'):
        assert executables()[rest[2]] == rest[1]
    elif line.words[:2] == ('ros2', 'launch'):
        package, file, *arguments = rest[1:]
        path = ROOT / 'ros2_ws/src' / package / 'launch' / file
        shared = sorted((ROOT / 'ros2_ws/src/spikelane/spikelane/launch').glob('*.py'))
        declared = ''.join(each.read_text('utf-8') for each in (path, *shared))
        for argument in arguments:
            name = re.escape(argument.partition(':=')[0])
            known = re.search(rf"(argument|flag)\(\s*'{name}'", declared)
            assert known or argument == '--show-args'
    elif line.words[:3] == ('ros2', 'param', 'set'):
        node, name, _ = rest[2:]
        specs = parameters_of(node.removeprefix('/')).specs()
        assert next(spec for spec in specs if spec.name == name).changes
    elif line.words[:3] == ('ros2', 'service', 'call'):
        _, _, name, kind, request = rest
        assert name == '/simulator/reset'
        assert kind.removeprefix('spikelane_msgs/srv/') == 'Reset'
        fields = (ROOT / 'msgs/spikelane_msgs/srv/Reset.srv').read_text('utf-8').split('---')[0]
        assert all(f' {field}\n' in fields for field in yaml.safe_load(request))
    elif first == 'python' and rest[0] != '-m':
        assert (ROOT / rest[0]).exists()
    elif '/' in first:
        assert (ROOT / first).exists()
    else:
        assert first in OTHERS[0] or line.words[:2] in OTHERS[1]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    """To files here, and to headings in them."""
    for target in re.findall(r'\]\(([^)#\s]*(?:#[^)\s]+)?)\)', page.read_text('utf-8')):
        if '://' in target:
            continue
        name, _, anchor = target.partition('#')
        path = (page.parent / name) if name else page
        assert path.exists(), target
        if anchor:
            titles = re.findall(r'^#+ (.+)$', path.read_text('utf-8'), re.M)
            slugs = {re.sub(r'[^\w\- ]', '', title.lower()).replace(' ', '-') for title in titles}
            assert anchor in slugs, target


@pytest.mark.parametrize(
    'script', sorted((ROOT / 'docs').rglob('*.py')), ids=lambda path: path.name
)
def test_a_script_that_names_its_interpreter_can_be_executed(script: Path) -> None:
    """As the pages call it."""
    if script.read_text('utf-8').startswith('#!'):
        assert os.access(script, os.X_OK)
