"""What packages register: entry points of a group, our own packages' first.

There are two ways to install Spikelane: as one distribution with pip, and as ROS packages with
colcon. Where both are on the path, what both register counts once.
"""

from __future__ import annotations

from collections.abc import Mapping
import functools
from importlib.metadata import entry_points, EntryPoint
import os
import sys
from typing import Any, TypeVar

from spikelane_sim.errors import ParameterError

#: The distribution that has all of our packages.
_DISTRIBUTION = 'spikelane'

KindT = TypeVar('KindT')


def registered(group: str, own: str = '') -> list[EntryPoint]:
    """Return the entry points of a group: those of one of our packages, then others', by name.

    Args:
        group: Name of the group.
        own: Our package that registers some in it; '' where none does.

    Raises:
        ParameterError: Our package has registered none. Its modules can be imported, since they
            are on Python's path, but it is not installed.
    """
    points = _all_points(_state_of_path()).select(group=group)
    found = {(package_of(each), each.name, each.value): each for each in points}
    if own and not any(package == own for package, _, _ in found):
        raise ParameterError(
            f'{group}: expected the entry points of {own}, got none: it is on the path, but not '
            'installed; run `pip install .` or `setup/bootstrap run` in the repository'
        )
    order = sorted(found, key=lambda key: (key[0] != own, key[1], key[0]))
    return [found[key] for key in order]


def _state_of_path() -> tuple[tuple[str, int], ...]:
    """Return Python's path with the times at which something was installed there [ns]."""
    folders = (folder for folder in sys.path if os.path.isdir(folder or '.'))
    return tuple((folder, os.stat(folder or '.').st_mtime_ns) for folder in folders)


@functools.lru_cache(maxsize=1)
def _all_points(state: tuple[tuple[str, int], ...]) -> Any:
    """Return the entry points of all groups: a search reads a file of every distribution."""
    del state  # only says whether the last search is still valid
    return entry_points()


@functools.cache
def loaded(group: str, kind: type[KindT], own: str = '') -> Mapping[str, KindT | str]:
    """Return what the entry points of a group name.

    Args:
        group: As in `registered`.
        kind: What each must be.
        own: As in `registered`.

    Returns:
        All by name; for one that cannot be had, the reason.

    Raises:
        ParameterError: As in `registered`.
    """
    found: dict[str, KindT | str] = {}
    for point in registered(group, own):
        try:
            value = point.load()
        # Another package's module can raise anything; one that calls sys.exit must not end us.
        except (Exception, SystemExit) as error:
            found[point.name] = f'expected {point.value}, got {error!r:.200}'
        else:
            is_kind = isinstance(value, kind)
            found[point.name] = (
                value if is_kind else f'expected {kind.__name__}, got {value!r:.200}'
            )
    return found


def known(what: str, found: Mapping[str, KindT | str], name: str) -> KindT:
    """Return what has a name.

    Args:
        what: The parameter that gives the name, for the message.
        found: What `loaded` has returned.
        name: The name.

    Raises:
        ParameterError: Nothing has this name, or it cannot be had.
    """
    if name not in found:
        raise ParameterError(f'{what}: expected one of {", ".join(found)}, got {name!r}')
    value = found[name]
    if isinstance(value, str):
        raise ParameterError(f'{what}: {name} cannot be used: {value}')
    return value


def package_of(point: EntryPoint) -> str:
    """Return the ROS package that registers an entry point; '' where it is not known."""
    name = point.dist.metadata['Name'].replace('-', '_') if point.dist else ''
    return point.module.partition('.')[0] if name == _DISTRIBUTION else name
