"""When the simulator steps: the lockstep protocol, real time, and the states of a simulation.

In lockstep each observation is published and then waits for the wheel velocities that carry its
stamp; nothing sleeps or polls, and a command with another stamp changes nothing. In real time
the steps come from a clock outside, and the last command holds for half a second.

Calls may come from several threads: commands from one, services and timers from another.
"""

from __future__ import annotations

from collections.abc import Callable
import threading

from spikelane_sim.contract import (
    Observation,
    RobotState,
    STANDSTILL,
    STEP_NS,
    WheelVelocities,
)
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.run_state import OnPublished, Publish, RunState
from spikelane_sim.simulator import Simulator


class _Advance:
    """A number of steps asked for while the simulation is paused."""

    def __init__(self, steps: int, on_step: Callable[[int, bool], None]) -> None:
        self.steps, self.completed, self.on_step = steps, 0, on_step


class Stepper:
    """Runs a simulator by the answers that come from outside."""

    def __init__(
        self,
        simulator: Simulator,
        publish: Publish,
        *,
        seed: int,
        lane: str | None = None,
        hold_ns: int | None = None,
    ) -> None:
        """Start in the state STOPPED.

        Args:
            simulator: What is stepped.
            publish: Where observations go.
            seed: Seed of the first sequence of episodes, and of each after a full reset.
            lane: Lane of the first episode, and of each after a full reset; None for the course's
                first.
            hold_ns: How long a command holds [ns of simulation time] in real time, at least for
                one step; None for lockstep.

        Raises:
            SpikelaneError: No such lane.
        """
        simulator.clear(lane)
        self._simulator = simulator
        self._publish = publish
        self._seed, self._lane = seed, lane
        self._hold_ns = None if hold_ns is None else max(hold_ns, STEP_NS)
        self._lock = threading.RLock()
        self._state = RunState.STOPPED
        self._observation: Observation | None = None
        self._is_published = False
        self._on_published: list[OnPublished] = []
        self._answer: WheelVelocities | None = None
        self._command = STANDSTILL
        self._command_ns = 0
        self._advance: _Advance | None = None
        self.ignored_commands = 0
        self.steps = 0

    @property
    def state(self) -> RunState:
        """State of the simulation."""
        return self._state

    @property
    def is_lockstep(self) -> bool:
        """Whether each observation waits for its answer."""
        return self._hold_ns is None

    @property
    def observation(self) -> Observation | None:
        """The last observation; None before an episode begins."""
        return self._observation

    @property
    def is_waiting(self) -> bool:
        """Whether a lockstep observation is out that nobody has answered."""
        with self._lock:
            return self._hold_ns is None and self._may_step and self._answer is None

    @property
    def lacks_subscribers(self) -> bool:
        """Whether an observation is not out yet, since not all are there who must hear it."""
        with self._lock:
            return self._observation is not None and not self._is_published

    @property
    def is_awaited(self) -> bool:
        """Whether somebody who asked for an episode waits for its first observation."""
        with self._lock:
            return bool(self._on_published)

    def robot(self) -> tuple[int, RobotState]:
        """Return simulation time [ns] and the robot's pose and motion, between two steps."""
        with self._lock:
            return self._simulator.time_ns, self._simulator.robot_state

    @property
    def is_answered(self) -> bool:
        """Whether the last observation has been answered, or needs no answer, as in real time.

        In lockstep the last one of an episode is answered, too.
        """
        with self._lock:
            return self._hold_ns is not None or self._answer is not None

    def begin(
        self,
        lane: str | None = None,
        seed: int | None = None,
        *,
        episode: int = 1,
        from_time_zero: bool = False,
        on_published: OnPublished | None = None,
    ) -> None:
        """Begin an episode, and play unless paused; steps asked for in the last one are dropped.

        Args:
            lane: As in `Simulator.reset`; None for the first one's at the beginning of all.
            seed: As in `Simulator.reset`; None for the first one's at the beginning of all.
            episode: As in `Simulator.reset`.
            from_time_zero: As in `Simulator.reset`; so it is at the beginning of all.
            on_published: Called with the first observation once it is published; with None where
                the next episode begins, or all stops or has stopped for good, before that.

        Raises:
            SpikelaneError: As in `Simulator.reset`; nothing has changed then.
        """
        with self._lock:
            if self._state is RunState.QUITTING:
                if on_published is not None:
                    on_published(None)
                return
            from_time_zero |= self._observation is None
            if from_time_zero:
                lane = self._lane if lane is None else lane
                seed = self._seed if seed is None else seed
            observation = self._simulator.reset(
                lane, seed, episode=episode, from_time_zero=from_time_zero
            )
            self.cancel_advance()
            if self._state is RunState.STOPPED:
                self._state = RunState.PLAYING
            self._command = STANDSTILL
            self._tell_of(None)
            self._show(observation, on_published)

    def reset_time(self, on_published: OnPublished) -> None:
        """Let simulation time begin again within the episode.

        Args:
            on_published: As in `begin`, with the observation of the new time.

        Raises:
            SpikelaneError: No episode has begun since the start or the last `stop`.
        """
        with self._lock:
            if self._observation is None:
                raise SpikelaneError('no episode has begun: reset the simulation first')
            self._command_ns = 0
            self._show(self._simulator.reset_time(), on_published)

    def command(self, stamp_ns: int | None, wheels: WheelVelocities) -> None:
        """Take wheel velocities.

        Args:
            stamp_ns: Stamp of the observation answered; of no meaning in real time.
            wheels: The velocities.
        """
        with self._lock:
            if self._hold_ns is not None:
                self._command, self._command_ns = wheels, self._simulator.time_ns
            elif (
                self._observation is None
                or not self._is_published
                or stamp_ns != self._observation.stamp_ns
                or self._answer is not None
            ):
                self.ignored_commands += 1
            else:
                self._take_answer(wheels)

    def tick(self) -> None:
        """Take one step of real time, if the simulation plays and an episode runs."""
        with self._lock:
            if self._state is RunState.PLAYING and self._may_step:
                self._step(self._held_command())

    def play(self) -> None:
        """Go on, or begin where nothing has begun."""
        with self._lock:
            if self._state is RunState.QUITTING:
                return
            self._state = RunState.PLAYING
            if self._observation is None:
                self.begin(from_time_zero=True)
            elif self._answer is not None:
                self._take_answer(self._answer)

    def pause(self) -> None:
        """Take no further step until `play` or `advance`."""
        with self._lock:
            if self._state is not RunState.QUITTING:
                self._state = RunState.PAUSED

    def stop(self) -> None:
        """Pause, and forget everything: the next episode begins at time zero with the first seed.

        The robot is put back at once.
        """
        with self._lock:
            if self._state is not RunState.QUITTING:
                self._state = RunState.STOPPED
            self._observation = None
            self._answer = None
            self._simulator.clear(self._lane)
            self.cancel_advance()
            self._tell_of(None)

    def quit(self) -> bool:
        """Take no further step and publish nothing more, for good.

        Returns:
            Whether that cuts an episode short in which steps have been taken.
        """
        with self._lock:
            self._state = RunState.QUITTING
            self.cancel_advance()
            self._tell_of(None)
            lane = None if self._observation is None else self._observation.lane
            return lane is not None and lane.step > 0 and not lane.terminated

    def advance(self, steps: int, on_step: Callable[[int, bool], None]) -> None:
        """Take some steps of a paused simulation; they are answered as in play.

        Where no controller is there, or in real time, the last command holds.

        Args:
            steps: How many, at least 1.
            on_step: Called after each step with the number taken, and whether no more will come
                (all are taken, the episode is over, or they are cancelled).

        Raises:
            SpikelaneError: Not paused, steps are being taken already, or the episode is over.
        """
        with self._lock:
            if self._state is not RunState.PAUSED:
                raise SpikelaneError('steps can be asked for only while the simulation is paused')
            if self._advance is not None:
                raise SpikelaneError('other steps are being taken')
            if self._observation is None:
                self.begin(from_time_zero=True)
            if not self._is_running:
                raise SpikelaneError('the episode is over: reset the simulation first')
            self._advance = _Advance(steps, on_step)
            if self._answer is not None:
                self._take_answer(self._answer)

    def advance_held(self) -> bool:
        """Take one of the steps asked for with the last command, where nobody will answer.

        Returns:
            Whether a step was taken.
        """
        with self._lock:
            if self._advance is None or not self._is_running:
                return False
            if self._hold_ns is None and self._publish.has_controller():
                return False
            self._step(self._held_command())
            return True

    def cancel_advance(self) -> None:
        """Take no more of the steps asked for."""
        with self._lock:
            advance, self._advance = self._advance, None
            if advance is not None:
                advance.on_step(advance.completed, True)

    def place(self, x_m: float, y_m: float, heading_rad: float) -> None:
        """Move the robot elsewhere between two steps; see `Simulator.place`.

        Raises:
            PoseError: The robot cannot be there.
            SpikelaneError: No episode is running.
        """
        with self._lock:
            if self._state is RunState.STOPPED:
                raise SpikelaneError('the simulation is stopped: begin an episode first')
            self._simulator.place(x_m, y_m, heading_rad)

    def audience_changed(self, has_grown: bool = True) -> None:
        """Publish the observation that still waits, once all are there who must hear it.

        Args:
            has_grown: Whether somebody has missed it: then it is published again.
        """
        with self._lock:
            if self._observation is not None and (has_grown or not self._is_published):
                self._publish_if_heard()

    @property
    def _is_running(self) -> bool:
        lane = self._observation.lane if self._observation is not None else None
        return lane is not None and not lane.terminated

    @property
    def _may_step(self) -> bool:
        is_asked = self._state is RunState.PLAYING or self._advance is not None
        return is_asked and self._is_running and self._is_published

    def _take_answer(self, wheels: WheelVelocities) -> None:
        if self._may_step:
            self._step(wheels)
        else:
            self._answer = wheels

    def _step(self, wheels: WheelVelocities) -> None:
        self._command = wheels
        observation = self._simulator.step(wheels)
        self.steps += 1
        self._show(observation)
        advance = self._advance
        if advance is not None:
            advance.completed += 1
            is_over = advance.completed >= advance.steps or not self._is_running
            if is_over:
                self._advance = None
            advance.on_step(advance.completed, is_over)

    def _held_command(self) -> WheelVelocities:
        if self._hold_ns is None:
            return self._command
        is_fresh = self._simulator.time_ns - self._command_ns < self._hold_ns
        return self._command if is_fresh else STANDSTILL

    def _show(self, observation: Observation, on_published: OnPublished | None = None) -> None:
        self._observation = observation
        self._answer = None
        self._is_published = False
        if on_published is not None:
            self._on_published.append(on_published)
        self._publish_if_heard()

    def _publish_if_heard(self) -> None:
        observation = self._observation
        if observation is None or self._state is RunState.QUITTING:
            return
        if not (self._is_published or self._publish.has_subscribers()):
            return
        is_new, self._is_published = not self._is_published, True
        self._publish.observation(observation, is_new)
        self._tell_of(observation)

    def _tell_of(self, observation: Observation | None) -> None:
        callbacks, self._on_published = self._on_published, []
        for callback in callbacks:
            callback(observation)
