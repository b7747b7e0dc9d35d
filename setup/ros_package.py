"""What the setup.py of a ROS package says: its part of the repository's pyproject.toml.

colcon builds three packages of the code that `pip install .` installs as one. Versions,
dependencies and entry points stand in pyproject.toml; a setup.py adds the nodes' executables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
import re
from typing import Any

from setuptools import find_packages

# The parser of TOML that setuptools has: Python 3.10 has none.
from setuptools.config.pyprojecttoml import load_file

#: Folders with files that ROS finds by the package, with their names' endings.
_SHARED = {'config': '*.*', 'launch': '*.launch.py'}
#: All files in the folders of modules that are no modules.
_DATA = [
    'py.typed',
    '**/*.html',
    '**/*.json',
    '**/*.safetensors',
    '**/*.urdf',
    '**/*.xml',
    '**/*.yaml',
]


def project() -> dict[str, Any]:
    """Return the table [project] of pyproject.toml."""
    file = Path(__file__).resolve().parent.parent / 'pyproject.toml'
    found: dict[str, Any] = load_file(str(file))['project']
    return found


def registered(group: str) -> dict[str, str]:
    """Return the entry points of a group, by name."""
    points: dict[str, str] = project()['entry-points'][group]
    return points


def setup_arguments(name: str, nodes: Mapping[str, str]) -> dict[str, Any]:
    """Return the arguments of setuptools' `setup` for a ROS package.

    Args:
        name: Name of the package and of the folder with its modules. The folder is in the current
            one, as are the modules that have no package.
        nodes: Executables that only ROS has, with their functions.
    """
    whole = project()
    [author] = whole['authors']
    groups = {group: _own(name, points) for group, points in whole['entry-points'].items()}
    scripts = _own(name, whole['scripts']) + _points(nodes)
    groups = {'console_scripts': scripts, **groups}
    return {
        'name': name,
        'version': whole['version'],
        'description': f'ROS package {name} of Spikelane',
        'license': whole['license'],
        'maintainer': author['name'],
        'maintainer_email': author['email'],
        'python_requires': whole['requires-python'],
        'install_requires': ['setuptools', *whole['dependencies']],
        # By the extra `test` colcon knows what to test a package with.
        'extras_require': {**whole['optional-dependencies'], 'test': ['pytest']},
        'packages': find_packages(),
        'py_modules': [path.stem for path in Path().glob(f'{name}_*.py')],
        'package_data': {name: _DATA},
        'data_files': [
            ('share/ament_index/resource_index/packages', [f'resource/{name}']),
            (f'share/{name}', ['package.xml']),
            *_shared(name),
        ],
        'entry_points': {group: points for group, points in groups.items() if points},
        'zip_safe': False,
    }


def _own(name: str, points: Mapping[str, str]) -> list[str]:
    """Return the entry points that are in a package's modules."""
    modules = (name, f'{name}_entry')
    found = {
        each: place for each, place in points.items() if re.split('[.:]', place)[0] in modules
    }
    return _points(found)


def _points(points: Mapping[str, str]) -> list[str]:
    return [f'{name} = {place}' for name, place in points.items()]


def _shared(name: str) -> Sequence[tuple[str, list[str]]]:
    found = {folder: sorted(map(str, Path(folder).glob(end))) for folder, end in _SHARED.items()}
    return [(f'share/{name}/{folder}', files) for folder, files in found.items() if files]
