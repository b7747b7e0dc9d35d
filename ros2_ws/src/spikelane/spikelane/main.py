"""The `spikelane` command."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import importlib
import os
import sys
from typing import Any, NoReturn

from spikelane.interruption import Interrupted, signals_noted

#: Sub-commands that do one run, each a package of `spikelane.runs`.
_RUNS = ('lap', 'train', 'transfer', 'replay', 'evaluate')

#: Sub-commands and what they are for; the others are modules of `spikelane.commands`.
COMMANDS = {
    'lap': 'drive one lap, measure and draw it',
    'train': 'let a controller learn by driving',
    'transfer': 'teach a spiking network the policy of a trained Q-network',
    'export': 'write a spiking network in a format that other programs read',
    'replay': 'replay a recorded drive to a controller, and compare',
    'repair': 'repair a bag whose recorder was killed',
    'camera': 'write the lens and the place of a simulated camera to a file',
    'mask': "find a camera's hot pixels in a recording",
    'evaluate': 'measure a controller over laps and seeds',
    'experiment': 'execute all runs that a file describes',
    'reproduce': 'repeat all experiments of the paper and write a report',
    'report': 'write one page that compares many runs with the paper',
    'compare': 'compare the runs of two settings, with intervals and p-values',
    'course': 'check a course, describe it and draw it',
    'check': 'test a controller against the whole contract',
    'view': 'show in the browser what a robot does',
    'parameters': 'list the parameters of a controller or of the simulator',
    'node': 'run one node of the graph',
    'bench': 'measure how fast everything is',
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command and exit, with what `run` returns."""
    with signals_noted(are_ignored_afterwards=True):
        status = _run(sys.argv[1:] if arguments is None else arguments)
    try:
        sys.stdout.flush()
    except OSError:  # said already; the interpreter would try once more, and end with 120
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)


def run(arguments: Sequence[str]) -> int:
    """Run the command.

    Returns:
        0 done, 1 failed, 2 wrong use, 128 + n when ended by signal n.

    Raises:
        SystemExit: Help was asked for (0), or the arguments cannot be understood (2).
    """
    with signals_noted():
        return _run(arguments)


def _run(arguments: Sequence[str]) -> int:
    # Here and not above: signals must be noted before anything that takes long is imported.
    from spikelane_sim.errors import SpikelaneError

    try:
        # It names the controllers there are, which another package's may make impossible.
        options = _parser(arguments).parse_args(arguments)
        options.command_line = list(arguments)
        status = int(options.run(options))
        sys.stdout.flush()
        return status
    except SpikelaneError as error:
        return _fail(arguments, str(error), error.exit_status)
    except OSError as error:
        # Our files say themselves what failed: without a name it is what we print.
        where = error.filename or 'standard output'
        return _fail(arguments, f'{where}: {error.strerror or repr(error)}', 1)
    except Interrupted as interrupted:
        return interrupted.exit_status


def _fail(arguments: Sequence[str], why: str, status: int) -> int:
    """Say in one line why a command failed, and return its exit status."""
    from spikelane_sim.errors import one_line

    print(one_line(f'{" ".join(["spikelane", *arguments[:1]])}: {why}'), file=sys.stderr)
    return status


class _Parser(argparse.ArgumentParser):
    """Says in one line what was wrong; the usage is shown only with --help."""

    def error(self, message: str) -> NoReturn:
        # Here and not above: signals must be noted before anything is imported that takes long.
        from spikelane_sim.errors import one_line

        self.exit(2, f'{self.prog}: {one_line(message)}\n')


class _Version(argparse.Action):
    """Prints the version; looked up only then, which takes its time."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        import importlib.metadata

        print(f'spikelane {importlib.metadata.version("spikelane")}')
        parser.exit()


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    parser = _Parser(
        prog='spikelane', description='Lane keeping with event cameras and spiking networks.'
    )
    parser.add_argument('--version', action=_Version, nargs=0, help='show the version and exit')
    commands = parser.add_subparsers(dest='command', required=True, metavar='COMMAND')
    for name, purpose in COMMANDS.items():
        sub = commands.add_parser(name, help=purpose, description=f'{purpose.capitalize()}.')
        # Only the one that is run is imported: the others' libraries take their time.
        if arguments and arguments[0] == name:
            is_run = name in _RUNS
            module = importlib.import_module(
                f'spikelane.runs.{name}.command' if is_run else f'spikelane.commands.{name}'
            )
            module.add_arguments(sub)
            sub.set_defaults(run=module.run)
    return parser


if __name__ == '__main__':
    main()
