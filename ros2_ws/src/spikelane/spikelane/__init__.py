"""Spikelane: lane keeping with an event camera and spiking neural networks.

The public functions and classes are those of `__all__`; everything else is internal and may
change. They are imported when they are first used, as what they need takes a second. Importing
this package registers the environment `spikelane/LaneKeeping-v0` with Gymnasium.
"""

from typing import Any, TYPE_CHECKING

import spikelane_sim  # noqa: F401

if TYPE_CHECKING:
    from spikelane.api import drive, evaluate, make_controller, train
    from spikelane.finished import load_run, Run, RunError

__all__ = ['Run', 'RunError', 'drive', 'evaluate', 'load_run', 'make_controller', 'train']


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from spikelane import api, finished

    for module in (api, finished):
        if hasattr(module, name):
            globals()[name] = getattr(module, name)
            break
    return globals()[name]


def __dir__() -> list[str]:
    return [*globals(), *__all__]
