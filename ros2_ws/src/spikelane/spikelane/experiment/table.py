"""Shows people how an experiment goes on: a live table, or lines where there is no terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from spikelane.experiment.runner import Runner, RunStatus, Status

_BAR_WIDTH = 20
_MARKS = {RunStatus.RUNNING: 'began', RunStatus.DONE: 'done', RunStatus.FAILED: 'FAILED'}


@contextlib.contextmanager
def shown(
    runner: Runner, slots: int, is_quiet: bool, console: Console | None = None
) -> Iterator[Callable[[Status | None], None]]:
    """Give what `Runner.run` is to call.

    Args:
        runner: Whose runs are shown.
        slots: Runs at a time.
        is_quiet: Whether to show nothing.
        console: Where to; the standard error without.
    """
    console = console or Console(stderr=True)
    if is_quiet:
        yield lambda status: None
    elif not console.is_terminal:
        yield lambda status: _print_line(console, runner, status)
    else:
        with Live(console=console, auto_refresh=False) as live:

            def show(status: Status | None) -> None:
                if status is not None and status.state is not RunStatus.RUNNING:
                    _print_line(live.console, runner, status)
                live.update(render(runner, slots), refresh=True)

            yield show


def render(runner: Runner, slots: int) -> Group:
    """Return the table: what runs, how far it is, how fast, and how long it will take."""
    table = Table(box=None, pad_edge=False)
    table.add_column('running')
    for name in ('', 'done', 'steps/s', 'left'):
        table.add_column(name, justify='right', no_wrap=True)
    for status in runner.statuses.values():
        if status.state is RunStatus.RUNNING:
            share = status.last[1].share if status.last else 0.0
            speed = status.steps_per_s
            table.add_row(
                status.run.name,
                ProgressBar(total=1.0, completed=share, width=_BAR_WIDTH),
                f'{100 * share:.0f} %',
                '' if speed is None else f'{speed:,.0f}',
                _duration(status.left_s),
            )
    counts = runner.counts
    failed = f', {counts.failed} failed' if counts.failed else ''
    left = _duration(time_left_s(runner, slots))
    summary = f'{counts.finished} of {counts.total} runs finished{failed}'
    return Group(table, Text(summary + (f', about {left} left' if left else '')))


def time_left_s(runner: Runner, slots: int) -> float | None:
    """Estimate how long all will take [s]: a run of unknown speed like those of its kind.

    Runs of the same task and controller are of one kind. None where no run's speed is known.
    """
    whole_s: dict[tuple[str, str], list[float]] = {}
    known_s: list[float] = []
    unknown: list[tuple[str, str]] = []
    for status in runner.statuses.values():
        kind = status.run.task, status.run.point.controller
        if status.took_s is not None:
            whole_s.setdefault(kind, []).append(status.took_s / status.together)
        elif status.state is RunStatus.RUNNING and status.left_s is not None and status.last:
            # Runs that a process does together share its time equally.
            left_s = status.left_s / status.together
            known_s.append(left_s)
            if (rest := 1.0 - status.last[1].share) > 0:
                whole_s.setdefault(kind, []).append(left_s / rest)
        elif status.state in (RunStatus.RUNNING, RunStatus.WAITING):
            unknown.append(kind)
    if not known_s or not set(unknown) <= set(whole_s):
        return None
    guessed_s = [sum(whole_s[kind]) / len(whole_s[kind]) for kind in unknown]
    return (sum(known_s) + sum(guessed_s)) / slots


def _print_line(console: Console, runner: Runner, status: Status | None) -> None:
    if status is None:
        return
    counts = runner.counts
    mark = _MARKS.get(status.state, 'again')  # one that was killed waits
    reason = f': {status.message}' if status.message else ''
    text = f'{counts.finished:4}/{counts.total} {mark:7} {status.run.name}{reason}'
    console.print(Text(text), soft_wrap=True)


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return ''
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f'{hours}:{minutes:02}:{rest:02}' if hours else f'{minutes}:{rest:02}'
