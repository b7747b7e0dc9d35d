"""Where the `spikelane` command begins: from here on a signal ends it without a traceback.

It is no module of `spikelane`, whose import takes 0.2 s, as it registers the environment with
Gymnasium. Python's own start comes before, about 30 ms, and in the script that colcon installs the
search for this module, about 40 ms more. Ctrl-C still shows a traceback then.
"""

import signal


def main() -> None:
    """Run the command and exit.

    Until `spikelane.main` has been imported, which takes notice of signals, SIGINT simply ends the
    process, as SIGTERM does. Where it was ignored from the start, it stays so.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from spikelane.main import main as run

    run()
