"""Registers the environment with Gymnasium, which need not be imported for that.

Gymnasium takes a tenth of a second to import, and most commands and nodes do not use it. It has no
entry points for environments since version 1.0.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.machinery import ModuleSpec
import sys
from types import ModuleType


def register_when_imported() -> None:
    """Register the environment now where Gymnasium is imported, otherwise right after it is."""
    if 'gymnasium' in sys.modules:
        _register()
    else:
        sys.meta_path.insert(0, _AfterGymnasium())


def _register() -> None:
    import gymnasium

    gymnasium.register(
        'spikelane/LaneKeeping-v0',
        entry_point='spikelane_sim.env:LaneKeepingEnv',
        vector_entry_point='spikelane_sim.fleet.vector_env:make_vector_env',
    )


class _AfterGymnasium:
    """Finds Gymnasium as the other finders do, and registers the environment once it is loaded."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return the specification of Gymnasium; None for every other module."""
        if name != 'gymnasium':
            return None
        others = (each for each in sys.meta_path if each is not self)
        found = (finder.find_spec(name, path, target) for finder in others)
        spec = next((each for each in found if each), None)
        if spec and spec.loader:
            self._prepare(spec.loader)
        return spec

    def _prepare(self, loader: object) -> None:
        """Let a loader register the environment after it has executed the module."""
        execute = loader.exec_module  # type: ignore[attr-defined]

        def exec_module(module: ModuleType) -> None:
            execute(module)
            if self in sys.meta_path:
                sys.meta_path.remove(self)
                _register()

        loader.exec_module = exec_module  # type: ignore[attr-defined]
