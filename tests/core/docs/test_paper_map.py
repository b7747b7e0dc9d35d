"""The paper map in controllers/README.md names what there is, with its defaults."""

import importlib
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from spikelane.runs.train.config import training_defaults
from spikelane_controllers.dqn_snn.transfer import TransferParameters
from spikelane_controllers.learning.gathering import GatheringParameters
from spikelane_controllers.registry import controller_class, controller_names, training_class
from spikelane_sim.parameters import ParameterSpec
from spikelane_sim.simulator_parameters import SimulatorParameters

_ROOT = Path(__file__).parents[3]
_HEAD = ['symbol', 'name in code', 'unit', 'default', 'place in the paper', 'file']
_NONE = '–'  # noqa: RUF001  # a dash stands where there is nothing
_ELSEWHERE = 'see file'


class Row(NamedTuple):
    """A row of the map; '' where it has nothing."""

    symbol: str
    name: str
    unit: str
    default: str
    place: str
    file: str
    heading: str

    @property
    def controller(self) -> str:
        """Return the controller whose training the row describes."""
        return 'dqn' if self.heading == 'Deep Q-learning' else 'rstdp'


def read_map() -> list[Row]:
    """Return the rows of all tables with the map's columns, `default` or not."""
    rows: list[Row] = []
    columns: list[str] = []
    heading = ''
    for line in (_ROOT / 'controllers/README.md').read_text('utf-8').splitlines():
        cells = [cell.strip().strip('`') for cell in line.strip('|').split('|')]
        if line.startswith('#'):
            heading = line.strip('# ')
        if not line.startswith('|'):
            columns = []
        elif not columns:
            columns = cells
        elif cells[0].strip('-') and columns[1] == 'name in code':
            named = dict(zip(columns, cells, strict=True))
            assert set(named) <= set(_HEAD)
            cells = [named.get(name, '').replace(_NONE, '') for name in _HEAD]
            rows.append(Row(*cells, heading))
    return rows


ROWS = read_map()
PARAMETERS = [row for row in ROWS if '.' in row.name and row.name[0].islower()]
CONSTANTS = [row for row in PARAMETERS if ':' in row.name]
QUANTITIES = [row for row in ROWS if row not in PARAMETERS]


def specs(trained: str = 'rstdp') -> dict[str, ParameterSpec]:
    """Return all parameters under the names they have on the command line to train one."""
    classes: dict[str, Any] = {
        'simulator': SimulatorParameters,
        'transfer': TransferParameters,
        'gathering': GatheringParameters,
        'training': training_class(trained).parameters_class,
        **{name: controller_class(name).parameters_class for name in controller_names()},
    }
    return {
        spec.name: spec for group, cls in classes.items() for spec in cls.specs(prefix=f'{group}.')
    }


def test_the_map_is_found() -> None:
    """Otherwise the tests below would check nothing."""
    assert (len(PARAMETERS), len(CONSTANTS), len(QUANTITIES)) == (92, 2, 22)


@pytest.mark.parametrize('row', [row for row in PARAMETERS if row not in CONSTANTS])
def test_a_parameter_has_the_default_and_the_unit_in_the_map(row: Row) -> None:
    """As declared; of a training's, as it is set for training."""
    spec = specs(row.controller)[row.name]
    assert row.unit == spec.unit
    if row.default != _ELSEWHERE:
        default = training_defaults(row.controller).get(row.name, spec.default)
        assert row.default == str(default)


@pytest.mark.parametrize('row', CONSTANTS)
def test_a_constant_has_the_value_in_the_map(row: Row) -> None:
    """Its unit is in its name."""
    module, name = row.name.split(':')
    assert row.default == str(getattr(importlib.import_module(module), name))
    assert name.endswith(f'_{row.unit.upper()}')


@pytest.mark.parametrize('row', ROWS)
def test_what_the_map_names_is_in_the_file_it_names(row: Row) -> None:
    """Declared there, not only mentioned."""
    text = (_ROOT / row.file).read_text('utf-8')
    owner, _, name = row.name.replace(':', '.').rpartition('.')
    declared = (f'    {name}: ', f'\n{name} = ', f'self.{name} = ', f"('{name}', ")
    assert any(each in text for each in (*declared, f'def {name}(', f'class {name}('))
    if owner and row in QUANTITIES:
        assert f'class {owner}' in text or f'\n{owner} = ' in text


def test_every_value_from_the_papers_tables_is_in_the_map() -> None:
    """And every other parameter of the synapses, which decide what is learnt."""
    mapped = {row.name for row in ROWS}
    wanted = {
        name
        for name, spec in specs().items()
        if name.startswith('rstdp.') and ('Simulation parameters' in spec.source)
    }
    synapses = {name for name in specs() if name.startswith('rstdp.synapse.')}
    assert wanted | synapses <= mapped
    assert len(wanted) == 22
    of_dqn = {
        name
        for name, spec in specs().items()
        if name.startswith('dqn.') and 'DQN parameters' in spec.source
    }
    assert of_dqn <= mapped
    assert len(of_dqn) == 14


def test_every_value_from_the_papers_table_of_the_dqn_snn_is_in_the_map() -> None:
    """This includes its training and its neurons, which are the same in rounds of a transfer."""
    mapped = {row.name for row in ROWS}
    wanted = {
        name
        for name, spec in specs().items()
        if 'DQN-SNN parameters' in spec.source and not name.startswith('transfer.driving.')
    }
    assert wanted <= mapped
    assert len(wanted) == 8
