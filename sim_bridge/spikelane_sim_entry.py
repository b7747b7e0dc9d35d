"""Where the executables of nodes begin: from here on a signal ends them without a traceback.

It is no module of `spikelane_sim`, whose import takes 0.2 s. Python's own start comes before,
about 30 ms, and in the scripts that colcon installs the search for this module, about 40 ms more.
Ctrl-C still shows a traceback then, except below the scripts `spikelane` of the repository and
`spikelane node`, which hold signals back until here.
"""

import signal


def take_signals() -> None:
    """Let SIGINT simply end the process, as SIGTERM does, until the node takes notice of signals.

    Where it was ignored from the start, it stays so.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT, signal.SIGTERM))


def simulator() -> None:
    """Run the node and exit."""
    take_signals()
    from spikelane_sim.nodes.simulator import main

    main()
