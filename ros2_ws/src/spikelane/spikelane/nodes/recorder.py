"""Node `recorder`: records topics to a bag as `ros2 bag record` does, and loses nothing doing so.

Messages are not handed over one by one by an executor, which would cost ten times as much as
recording them: 20 times a second the recorder takes all that has arrived, and the middleware's
own time of reception becomes the log time. An executor serves only the parameters.

Nothing is lost as long as publishers keep enough. Those of a drive hold back the next step before
their history is full (`spikelane_sim.nodes.recorder_window`), and keep the last 1,000 messages of
/diagnostics and the last 10 of controller/weights, more than come while they wait. What any other
publisher keeps is its own affair. Lost messages are counted for each topic, and named at the end.

After a kill, all that was flushed is in the bag, but the last file lacks its end, so that rosbags
and other programs refuse it: `spikelane repair BAG` makes it whole.
"""

from __future__ import annotations

from collections.abc import Iterable
import datetime
import functools
import os
from pathlib import Path
import signal
import sys
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from spikelane.bag.recording import Recording
from spikelane.bag.writer import BagWriter
from spikelane.nodes.announcer import Announcer
from spikelane.nodes.periodic import Periodic
from spikelane.nodes.publishers import Publishers
from spikelane.nodes.recorded_topics import RecordedTopics
from spikelane.nodes.recorder_parameters import parse_facts, RecorderParameters
from spikelane_sim import topic_names
from spikelane_sim.errors import BagError, SpikelaneError
from spikelane_sim.nodes.direct import EVENTS_PERIOD_S
from spikelane_sim.nodes.given_parameters import warn_of_unused_parameters
from spikelane_sim.nodes.network import network_variables
from spikelane_sim.nodes.parameter_node import ParameterNode
from spikelane_sim.nodes.rclpy_internals import NotForExecutors
from spikelane_sim.nodes.ros_parameters import declare_parameters
from spikelane_sim.nodes.sole_publishers import is_sole, SOLE_TOPICS, SolePublishers

_TAKE_PERIOD_S = 0.05
_DISCOVERY_PERIOD_S = 0.05
_SERVICE_PERIOD_S = 0.2
_CHECK_PERIOD_S = 1.0
_GRACE_S = 1.0


class Stop:
    """Whether a signal has asked to stop.

    No threading.Event: its lock is held while it is set or waited for, so that a signal amid
    that, a second one say, would wait for itself for ever.

    Attributes:
        number: Number of the first signal that came; 0 where none has.
    """

    def __init__(self) -> None:
        self.number = 0

    def ask_for(self, number: int, frame: object) -> None:
        """Handle a signal."""
        del frame
        self.number = self.number or number


class Recorder(ParameterNode):
    """Subscribes raw to the wanted topics as they appear and writes what they carry."""

    def __init__(self) -> None:
        super().__init__('recorder')
        self._settings = declare_parameters(self, RecorderParameters)
        self._listed = self._resolve(self._settings.topics)
        self._clock_name = self.resolve_topic_name(topic_names.CLOCK)
        own = self.resolve_topic_name('~/state')
        self._excluded = self._resolve(self._settings.exclude)
        if own not in self._listed:  # to record it would be something to tell of again
            self._excluded += (own,)
        self._announcer = Announcer(self, own, self._listed, self._excluded)
        group = NotForExecutors()  # messages are taken by `take`
        self._sources = Publishers(self, self.resolve_topic_name('~/published'), group)
        self._excluded += (self._sources.topic,)
        sole = [name for name in self._listed if is_sole(name)]
        self._sole = SolePublishers(self, sole or SOLE_TOPICS)
        self._is_mixed = False
        self._unheard: dict[str, int] = {}  # messages published on topics never subscribed to
        self._writer = BagWriter(
            Path(self._settings.output or _default_output()),
            compression=self._settings.compression,
            chunk_bytes=self._settings.chunk_bytes,
            max_file_bytes=self._settings.max_file_bytes,
            custom_data=parse_facts(self._settings.custom_data),
        )
        use_sim_time = self.get_parameter('use_sim_time').value
        self._recording = Recording(self._writer, use_sim_time=use_sim_time)
        self._topics = RecordedTopics(
            self, self._writer, self._recording, group, self._settings.depth
        )
        self._needs_clock = use_sim_time
        wanted = ', '.join(self._listed) or 'all topics'
        self.get_logger().info(f'recording to {self._writer.path}, waiting for {wanted}')

    def spin(self, stop: Stop) -> None:
        """Record until told to stop.

        What waits for the recorder may have been told to stop as well: it has a moment to do so.

        Raises:
            BagError: The disk is full; the bag is closed.
        """
        executor = SingleThreadedExecutor()
        executor.add_node(self)
        jobs = [
            Periodic(_DISCOVERY_PERIOD_S, self.discover),
            Periodic(_SERVICE_PERIOD_S, functools.partial(executor.spin_once, timeout_sec=0)),
            Periodic(_CHECK_PERIOD_S, self.check_publishers),
            Periodic(EVENTS_PERIOD_S, self._topics.look_at_events),
            Periodic(self._settings.flush_period_s, self._writer.flush),
        ]
        deadline_s = 0.0
        while not stop.number or (self.is_waited_for and time.monotonic() < deadline_s):
            if not stop.number:
                deadline_s = time.monotonic() + _GRACE_S
            self.take()
            for job in jobs:
                job.run_if_due()
            time.sleep(_TAKE_PERIOD_S)
        executor.remove_node(self)

    @property
    def is_waited_for(self) -> bool:
        """Whether nodes are there that drive no further than what is recorded."""
        return self._announcer.is_waited_for or self._sources.are_publishing

    def take(self) -> None:
        """Write every message that has arrived."""
        arrivals = self._topics.take()
        if arrivals:
            self._recording.write(arrivals)
        self._sources.take()
        ids, met = self._topics.ids, self._topics.met
        self._announcer.announce(self._recording, ids, met, has_caught_up=not arrivals)

    def discover(self) -> None:
        """Subscribe to wanted topics that have a publisher now."""
        new = []
        found = dict(self.get_topic_names_and_types())
        for name in found:
            is_clock, is_wanted = name == self._clock_name, self._wants(name)
            if name in self._topics.ids or not (is_wanted or (is_clock and self._needs_clock)):
                continue
            publishers = self.get_publishers_info_by_topic(name)
            if publishers and self._topics.subscribe(
                name, found[name], publishers, is_wanted=is_wanted, is_clock=is_clock
            ):
                new.append(name)
        if new:
            self.get_logger().info(
                f'recording {len(self._topics)} topics; new: {", ".join(sorted(new))}'
            )

    def check_publishers(self) -> None:
        """Warn of publishers that are too many, or that a subscription does not suit."""
        self._is_mixed |= self._sole.look()
        self._topics.check_publishers()

    def finish(self) -> bool:
        """Write what has arrived, close the bag and say what is in it.

        Returns:
            Whether all is in it that was sent reliably, and by one publisher where there must be
            only one.

        Raises:
            BagError: The disk is full; the bag is closed.
        """
        self.take()
        self._topics.look_at_events()
        self._recording.end()
        self._writer.close()
        self._compare()
        count = self._writer.message_count
        lost = self._recording.lost_count + sum(self._unheard.values())
        self.get_logger().info(
            f'recorded {count} messages of {self._topics.recorded_count} topics to '
            f'{self._writer.path}, {lost} lost'
        )
        missing = [name for name in self._listed if name not in self._topics.ids]
        if missing:
            self.get_logger().warning(f'never published: {", ".join(missing)}')
        self._remove_if_empty()
        # Whoever just listens may record several graphs; a drive with two of them is nobody's.
        is_foul = self._is_mixed and bool(self._sources.names)
        return self._report_lost() and not is_foul

    def _remove_if_empty(self) -> None:
        needed = self._resolve(self._settings.needed)
        counts = self._writer.counts
        if needed and not any(counts.get(name) for name in needed):
            self._writer.remove()
            self.get_logger().warning(
                f'nothing was recorded of {", ".join(needed)}: {self._writer.path} is removed'
            )

    def why_cut_short(self) -> str:
        """Return why what is recorded is not a whole drive; '' where it is, or nobody said."""
        if self._announcer.is_waited_for:
            return 'while other nodes wait for what is recorded'
        names = self._sources.cut_short
        return f'before the work of {", ".join(names)} was done' if names else ''

    def _report_lost(self) -> bool:
        """Name the topics that lost messages; return whether none of them is reliable."""
        lost = self._recording.lost
        counts = {name: lost[of] for name, of in self._topics.ids.items() if of in lost}
        counts |= {name: count for name, count in self._unheard.items() if count}
        if not counts:
            return True
        told = ', '.join(f'{name} {count}' for name, count in counts.items())
        text = f'messages lost: {told}'
        # Who offers a topic as best effort puts up with losses.
        if all(self._topics.is_best_effort(name) for name in counts):
            self.get_logger().warning(text)
            return True
        self.get_logger().error(text)
        return False

    def _compare(self) -> None:
        """Compare what was recorded with what was published, as far as the publishers said so."""
        for name, first, last in self._sources.published():
            if name in self._topics.ids:
                self._recording.compare(self._topics.ids[name], first, last)
            else:
                self._unheard[name] = last - first + 1

    def _wants(self, name: str) -> bool:
        if name in self._excluded:
            return False
        # As `ros2 bag record --all`: hidden topics only where they are listed.
        return name in self._listed if self._listed else '/_' not in name

    def _resolve(self, names: Iterable[str]) -> tuple[str, ...]:
        # YAML and the command line of ROS know no empty list: [''] stands for it.
        return tuple(self.resolve_topic_name(name) for name in names if name)


def main(args: list[str] | None = None) -> int:
    """Record until SIGINT or SIGTERM.

    Returns:
        0; 1 if recording failed (a full disk) or reliable messages were lost; 2 if a parameter is
        wrong; 128 + n if signal n came while other nodes were waiting for what is recorded,
        or before their work was done.
    """
    stop = Stop()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop.ask_for)
    try:
        os.environ |= network_variables(os.environ)
    except SpikelaneError as error:
        print(f'error: {error}', file=sys.stderr)
        return 2
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    try:
        return _record(stop)
    finally:
        rclpy.try_shutdown()


def _record(stop: Stop) -> int:
    try:
        recorder = Recorder()
    except SpikelaneError as error:
        rclpy.logging.get_logger('recorder').error(str(error))
        return 2
    try:
        warn_of_unused_parameters(recorder, sys.argv)
        recorder.spin(stop)
        why = recorder.why_cut_short()
        if not recorder.finish():
            return 1
        if why := why or recorder.why_cut_short():
            name = signal.Signals(stop.number).name
            recorder.get_logger().warning(f'ended by {name} {why}')
            return 128 + stop.number
    except BagError as error:
        recorder.get_logger().error(str(error))
        return 1
    finally:
        recorder.destroy_node()
    return 0


def _default_output() -> str:
    return datetime.datetime.now().strftime('rosbag2_%Y_%m_%d-%H_%M_%S')


if __name__ == '__main__':
    sys.exit(main())
