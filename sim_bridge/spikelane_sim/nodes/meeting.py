"""How the nodes of a drive discover each other: which waits for which, and how loss is detected.

A drive in lockstep has three parties: the simulator, a controller, and often a recorder. They may
be started in any order and at any speed, and the middleware introduces them topic by topic, in an
order that is not defined. A message that is published before the subscriber is discovered never
reaches it. Therefore:

1. **Before the first step, publishers wait.** The simulator holds its first observation, and the
   controller its first answer, until all required subscribers are discovered (`Meeting.is_open`):

   - the nodes named by the parameter `wait_for`: each must subscribe to what it needs, the
     controller to `lane/state` and `event_camera/events`, the simulator to `wheel_velocities`;
   - the recorder, where `recorder_window_steps` is above 0: on every topic of the node that is to
     be recorded. The recorder says on `recorder/state` which topics it wants, and on which of them
     it has met a publisher. The node believes that when its own publisher has met as many
     subscribers as there are, the recorder among them: then both sides know of each other;
   - any `wait_for_subscribers` subscribers, for graphs of another kind.

   The recorder waits for no node, and the controller answers every observation, so that there is
   no deadlock. No node waits for a viewer or any other observer.

2. **The last message is re-sent to late joiners** (`KeptPublisher`), on the topics where they have
   missed it: an observation for a controller that was restarted, an answer for a simulator.

3. **During the drive, no publisher is further ahead of the recorder than its history allows**
   (`recorder_window`): it waits again.

4. **At the end, what was recorded is compared with what was published.** When a node has met the
   recorder, and again when it ends, it publishes on `recorder/published` which messages of each
   topic the recorder was to get. The recorder counts what it lacks, names the topics, and ends
   with status 1. A node that never said that it is done was cut short, and so is the recording.

Nobody waits for what it does not need: without `wait_for`, `wait_for_subscribers` and
`recorder_window_steps`, a node publishes from the start on, and nothing is compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from spikelane_msgs.msg import Published, RecorderState

from spikelane_sim import topic_names
from spikelane_sim.nodes.direct import DirectSubscriptions
from spikelane_sim.nodes.kept_publisher import full_name, KeptPublisher
from spikelane_sim.nodes.recorder_window import RecorderWindow
from spikelane_sim.parameters import parameter, Parameters

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
#: Messages that the publishers of a drive keep for a recorder.
RECORDED_DEPTH = 1000
#: Steps that each may be ahead of the recorder. The simulator's window is the smaller one: it is
#: the one that waits, and says so. Both leave room in the publishers' history for what is sent
#: again and for what is not known yet.
SIMULATOR_WINDOW_STEPS, CONTROLLER_WINDOW_STEPS = 400, 600

_LOOK_PERIOD_S = 0.05


@dataclass(frozen=True, kw_only=True)
class MeetingParameters(Parameters):
    """For whom a node waits before it publishes."""

    wait_for: tuple[str, ...] = parameter(
        (),
        'Nodes that must receive all messages from the first one on: a simulator waits for '
        'its controller, a controller for its simulator. A name without a leading slash is in '
        "the node's own namespace. If these nodes are given, a second publisher of a topic "
        'of the drive ends the node.',
    )
    wait_for_subscribers: int = parameter(
        0,
        'Number of subscribers that event_camera/events, or wheel_velocities, must have '
        'before anything is published; subscribers of any node count.',
        low=0,
        high=1000,
    )
    recorder_window_steps: int = parameter(
        0,
        'Number of steps that a drive in lockstep may be ahead of what the recorder has '
        'written, which must be well below history_depth. Nothing is published before the '
        'recorder is met on all topics that it is to record. 0: nothing waits for a recorder.',
        low=0,
        high=10**6,
    )
    history_depth: int = parameter(
        10,
        'Number of messages kept for a late subscriber; more messages cost time.',
        low=1,
        high=10**6,
    )


def meeting_parameters(controller: str, *, is_recorded: bool) -> tuple[dict[str, Any], ...]:
    """Return the parameters with which a simulator and a controller wait for each other.

    Args:
        controller: Name of its node, in the same namespace.
        is_recorded: Whether both wait for a recorder, too.

    Returns:
        Those of the simulator, and those of the controller.
    """
    both: tuple[dict[str, Any], ...] = ({'wait_for': [controller]}, {'wait_for': ['simulator']})
    if is_recorded:
        windows = (SIMULATOR_WINDOW_STEPS, CONTROLLER_WINDOW_STEPS)
        for each, steps in zip(both, windows, strict=True):
            each |= {'history_depth': RECORDED_DEPTH, 'recorder_window_steps': steps}
    return both


class Meeting:
    """Says whether all required subscribers of a node are discovered; see the module."""

    def __init__(
        self,
        node: Node,
        direct: DirectSubscriptions,
        settings: MeetingParameters,
        *,
        steps: Sequence[KeptPublisher],
        heard: int,
        others: Sequence[KeptPublisher],
        window_steps: int,
        on_open: Callable[[], None],
    ) -> None:
        """Begin to check which nodes are there.

        Args:
            node: The node that publishes.
            direct: Its subscriptions on the lockstep path, not started yet.
            settings: For whom to wait.
            steps: Publishers of one message a step, in the order of publishing.
            heard: How many of the last of `steps` each node of `wait_for` subscribes to.
            others: Other publishers of what is recorded.
            window_steps: The parameter `recorder_window_steps`, or 0 where there is no lockstep.
            on_open: Called, from any thread, when something may be published again.
        """
        self._node, self._direct, self._on_open = node, direct, on_open
        self._steps, self._others = steps, others
        self._subscribers = settings.wait_for_subscribers
        namespace = node.get_namespace().rstrip('/')
        names = [
            name if name[0] == '/' else f'{namespace}/{name}' for name in settings.wait_for if name
        ]
        self._needed = {each.topic: list(names) for each in steps[-heard:]}
        self.window = RecorderWindow(
            window_steps, lambda: {each.topic: each.sent for each in steps}
        )
        self._recorder: RecorderState | None = None
        # Numbers of the first messages that the recorder gets; None before it is met.
        self._first: dict[str, int] | None = None
        self.lacks: list[str] = []
        self._is_met = not names and not self.window.is_used
        if self.window.is_used:
            self._published = node.create_publisher(Published, topic_names.PUBLISHED, LATCHED)
            direct.subscribe(
                RecorderState,
                topic_names.RECORDER_STATE,
                self._on_recorder,
                LATCHED,
                is_companion=True,
                is_wanted=lambda: not self._is_met or self.window.wants_news,
            )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_LOOK_PERIOD_S, self._look, clock=steady)
        if self._is_met:
            self._timer.cancel()
        self._is_waiting_for_anybody = not self._is_met

    @property
    def needs_recorder(self) -> bool:
        """Whether nothing goes on before there is news of the recorder."""
        return self.window.is_full or (self.window.is_used and not self._is_met)

    @property
    def is_open(self) -> bool:
        """Whether the next step may be published; `on_open` is called once it may."""
        if not self._is_met or self._steps[-1].subscribers < self._subscribers:
            return False
        if self.window.is_full:
            self._direct.wake()  # and wait for the recorder
            return False
        return True

    def look_again(self) -> None:
        """Look whether all are still there: a subscriber was met or lost. In the executor."""
        if self._is_waiting_for_anybody and self._is_met:
            self.lacks = [text for each in self._all for text in self._absent(each)]
            if self.lacks:
                self._is_met = False
                self._timer.reset()
                self._direct.wake()  # and wait for news of the recorder

    def end(self, *, is_cut_short: bool) -> None:
        """Tell the recorder that nothing more is published, and what was."""
        if self._first is not None:
            self._publish(Published.CUT_SHORT if is_cut_short else Published.COMPLETE, self._first)

    @property
    def waits_for(self) -> str:
        """The nodes that this node waits for, in words; '' if there is none."""
        return '' if self._is_met else ', '.join(self.lacks)

    @property
    def _all(self) -> tuple[KeptPublisher, ...]:
        return (*self._steps, *self._others)

    def _on_recorder(self, state: RecorderState) -> None:
        self._recorder = state
        self.window.update(state)
        if self._is_met and not self.window.is_full:
            self._on_open()

    def _look(self) -> None:
        """Check repeatedly until all required nodes are discovered."""
        lacks = [] if self._recorder or not self.window.is_used else [self._no_recorder()]
        for each in self._all:
            absent = list(self._absent(each))
            if not absent and self._is_needed(each) and each.subscribers < len(each.listeners()):
                absent = [f'{each.topic} to reach all who subscribe to it']
            lacks += absent
        self.lacks = lacks
        if lacks:
            return
        self._timer.cancel()
        if self.window.is_used:
            self._first = {
                each.topic: 1 if each.is_latched else each.sent + 1
                for each in self._all
                if self._is_wanted(each)
            }
            self._publish(Published.PUBLISHING, self._first)
        self._is_met = True
        self._on_open()

    def _no_recorder(self) -> str:
        return f'a recorder that publishes {self._recorder_topic}'

    def _is_needed(self, publisher: KeptPublisher) -> bool:
        return bool(self._needed.get(publisher.topic)) or self._is_wanted(publisher)

    def _is_wanted(self, publisher: KeptPublisher) -> bool:
        """Return whether the recorder is to record what this one publishes."""
        state, topic = self._recorder, publisher.topic
        if state is None or topic in state.excluded:
            return False
        return topic in state.wanted if state.wanted else '/_' not in topic

    def _absent(self, publisher: KeptPublisher) -> Iterator[str]:
        """Yield the required subscribers that a publisher does not reach yet."""
        if not self._is_needed(publisher):
            return
        topic, there = publisher.topic, publisher.listeners()
        for name in self._needed.get(topic, ()):
            if name not in there:
                yield f'{name} to subscribe to {topic}'
        if self._recorder is not None and self._is_wanted(publisher):
            endpoints = self._node.get_publishers_info_by_topic(self._recorder_topic)
            is_there = any(full_name(each) in there for each in endpoints)
            if not is_there or topic not in self._recorder.met:
                yield f'the recorder to subscribe to {topic}'

    @property
    def _recorder_topic(self) -> str:
        return str(self._node.resolve_topic_name(topic_names.RECORDER_STATE))

    def _publish(self, state: int, first: Mapping[str, int]) -> None:
        sent = {each.topic: each.sent for each in self._all}
        message = Published(node=self._node.get_fully_qualified_name(), state=state)
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.topics = list(first)
        message.first = list(first.values())
        message.last = [sent[topic] for topic in first]
        self._published.publish(message)
