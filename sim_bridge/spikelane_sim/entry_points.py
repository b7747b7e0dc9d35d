"""What packages register: entry points of a group, our own packages' first.

There are two ways to install Spikelane: as one distribution with pip, and as ROS packages with
colcon. Where both are on the path, what both register counts once.
"""

from __future__ import annotations

from importlib.metadata import entry_points, EntryPoint

from spikelane_sim.errors import ParameterError

#: The distribution that has all of our packages.
_DISTRIBUTION = 'spikelane'


def registered(group: str, own: str = '') -> list[EntryPoint]:
    """Return the entry points of a group: those of one of our packages, then others', by name.

    Args:
        group: Name of the group.
        own: Our package that registers some in it; '' where none does.

    Raises:
        ParameterError: Our package has registered none. Its modules can be imported, since they
            are on Python's path, but it is not installed.
    """
    points = entry_points(group=group)
    found = {(package_of(each), each.name, each.value): each for each in points}
    if own and not any(package == own for package, _, _ in found):
        raise ParameterError(
            f'{group}: expected the entry points of {own}, got none: it is on the path, but not '
            'installed; run `pip install .` or `setup/bootstrap run` in the repository'
        )
    order = sorted(found, key=lambda key: (key[0] != own, key[1], key[0]))
    return [found[key] for key in order]


def package_of(point: EntryPoint) -> str:
    """Return the ROS package that registers an entry point; '' where it is not known."""
    name = point.dist.metadata['Name'].replace('-', '_') if point.dist else ''
    return point.module.partition('.')[0] if name == _DISTRIBUTION else name
