"""Installs what a command needs in addition, before it begins: cards of controllers name it."""

from __future__ import annotations

from collections.abc import Iterable
import importlib
import os
import subprocess

from spikelane_sim.errors import SpikelaneError

#: Variable with the path of `setup/bootstrap`. The script `spikelane` of a checkout sets it.
SETUP = 'SPIKELANE_SETUP'
_STDERR = 2  # standard output belongs to the command's result


class RequirementError(SpikelaneError):
    """What a command needs could not be installed."""

    exit_status = 1


def require(names: Iterable[str]) -> None:
    """Install lists of requirements that lack, where Spikelane runs from its own checkout.

    Elsewhere nothing is installed: what lacks is told by those who need it.

    Args:
        names: Names of lists in `requirements/`, as cards have them; '' for nothing.

    Raises:
        RequirementError: The set-up has failed; it has said why.
    """
    setup = os.environ.get(SETUP)
    for name in sorted(set(filter(None, names))) if setup else ():
        assert setup
        done = subprocess.run([setup, name], stdout=_STDERR, check=False)
        if done.returncode:
            raise RequirementError(
                f'setup/bootstrap {name}: expected a set-up, got exit status {done.returncode}'
            )
    importlib.invalidate_caches()
