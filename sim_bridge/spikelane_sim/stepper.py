"""When the simulator steps: the lockstep protocol, real time, and the states of a simulation.

In lockstep each observation is published and then waits for the wheel velocities that carry its
stamp; nothing sleeps or polls, and a command with another stamp changes nothing. In real time
the steps come from a clock outside, and the last command holds for half a second.

The state is a `RunState` and the `Phase` of the present observation. In lockstep, while an episode
runs, this becomes of it; `+` is a step that is taken, `-` means no change, `!` an error:

    ================  =======  =========  ========  ========  =========  ========  =======
    state, phase      begin    answer     heard     play      pause      advance   stop
    ================  =======  =========  ========  ========  =========  ========  =======
    stopped, none     playing  -          -         playing   paused     !         -
    playing, held     playing  -          playing   -         paused/h   !         stopped
    playing, waiting  playing  playing +  -         -         paused/w   !         stopped
    paused, none      paused/w -          -         playing   -          steps     stopped
    paused, held      paused/w -          paused/w  playing/h -          steps/h   stopped
    paused, waiting   paused/w paused/a   -         playing   -          steps     stopped
    paused, answered  paused/w -          -         playing + -          paused/w+ stopped
    steps asked for   paused/w paused/w+  -         playing   -          !         stopped
    quitting          -        -          -         -         -          !         -
    ================  =======  =========  ========  ========  =========  ========  =======

- The column "answer" is a command with the right stamp, "heard" means that all who must hear an
  observation are there, "advance" asks for one step of a paused simulation.
- /h, /w and /a are the phases held, waiting and answered. Where the table says "playing", "steps"
  or /w, a new observation is held instead if somebody does not hear it.
- "steps" is paused, with a step asked for that is not taken yet.
- Where the episode is over, an answer takes no step: the observation is then answered.
- In real time there are no answers: a tick of the clock takes a step while the simulation plays.

Calls may come from several threads: commands from one, services and timers from another.
"""

from __future__ import annotations

from collections.abc import Callable
import threading

from spikelane_sim.contract import Observation, RobotState, STANDSTILL, WheelVelocities
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.requested import HeldCommand, RequestedSteps
from spikelane_sim.run_state import OnPublished, Phase, Publish, RunState
from spikelane_sim.simulator import Simulator


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
        self._is_lockstep = hold_ns is None
        self._lock = threading.RLock()
        self._state, self._phase = RunState.STOPPED, Phase.NONE
        self._observation: Observation | None = None  # None in the phase NONE alone
        self._answer: WheelVelocities | None = None  # of the phase ANSWERED
        self._held = HeldCommand(hold_ns, simulator.parameters.period_ns)
        self._requested: RequestedSteps | None = None
        self._on_published: list[OnPublished] = []
        self.ignored_commands = 0
        self.steps = 0

    @property
    def state(self) -> RunState:
        """State of the simulation."""
        return self._state

    @property
    def phase(self) -> Phase:
        """What has become of the last observation."""
        return self._phase

    @property
    def is_lockstep(self) -> bool:
        """Whether each observation waits for its answer."""
        return self._is_lockstep

    @property
    def observation(self) -> Observation | None:
        """The last observation; None before an episode begins."""
        return self._observation

    @property
    def is_waiting(self) -> bool:
        """Whether a lockstep observation is out that nobody has answered."""
        with self._lock:
            return self._is_lockstep and self._phase is Phase.WAITING and self._may_step

    @property
    def lacks_subscribers(self) -> bool:
        """Whether an observation is not out yet, since a required subscriber is missing."""
        with self._lock:
            return self._phase is Phase.HELD

    @property
    def is_awaited(self) -> bool:
        """Whether the client that requested an episode waits for its first observation."""
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
            return not self._is_lockstep or self._phase is Phase.ANSWERED

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
            self._held.replace(STANDSTILL)
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
            self._held.begin_time_again()
            self._show(self._simulator.reset_time(), on_published)

    def command(self, stamp_ns: int | None, wheels: WheelVelocities) -> None:
        """Take wheel velocities.

        Args:
            stamp_ns: Stamp of the observation answered; of no meaning in real time.
            wheels: The velocities.
        """
        with self._lock:
            is_right = self._observation is not None and stamp_ns == self._observation.stamp_ns
            if not self._is_lockstep:
                self._held.give(wheels, self._simulator.time_ns)
            elif self._phase is Phase.WAITING and is_right:
                self._take_answer(wheels)
            else:
                self.ignored_commands += 1

    def tick(self) -> None:
        """Take one step of real time, if the simulation plays and an episode runs."""
        with self._lock:
            if self._state is RunState.PLAYING and self._may_step:
                self._step(self._held.wheels(self._simulator.time_ns))

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
            self._phase, self._observation, self._answer = Phase.NONE, None, None
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
            if self._requested is not None:
                raise SpikelaneError('other steps are being taken')
            if self._observation is None:
                self.begin(from_time_zero=True)
            if not self._is_running:
                raise SpikelaneError('the episode is over: reset the simulation first')
            self._requested = RequestedSteps(steps, on_step)
            if self._answer is not None:
                self._take_answer(self._answer)

    def advance_held(self) -> bool:
        """Take one of the steps asked for with the last command, where nobody will answer.

        Returns:
            Whether a step was taken.
        """
        with self._lock:
            if self._requested is None or not self._is_running:
                return False
            if self._is_lockstep and self._publish.has_controller():
                return False
            self._step(self._held.wheels(self._simulator.time_ns))
            return True

    def cancel_advance(self) -> None:
        """Take no more of the steps asked for."""
        with self._lock:
            requested, self._requested = self._requested, None
            if requested is not None:
                requested.cancel()

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
        """Publish the observation that still waits, once all required subscribers are there.

        Args:
            has_grown: Whether somebody has missed it: then it is published again.
        """
        with self._lock:
            if has_grown or self._phase is Phase.HELD:
                self._publish_if_heard()

    @property
    def _is_running(self) -> bool:
        lane = self._observation.lane if self._observation is not None else None
        return lane is not None and not lane.terminated

    @property
    def _may_step(self) -> bool:
        is_asked = self._state is RunState.PLAYING or self._requested is not None
        return is_asked and self._is_running and self._phase is not Phase.HELD

    def _take_answer(self, wheels: WheelVelocities) -> None:
        if self._may_step:
            self._step(wheels)
        else:
            self._phase, self._answer = Phase.ANSWERED, wheels

    def _step(self, wheels: WheelVelocities) -> None:
        self._held.replace(wheels)
        observation = self._simulator.step(wheels)
        self.steps += 1
        self._show(observation)
        requested = self._requested
        if requested is not None:
            if requested.count(self._is_running):
                self._requested = None
            requested.tell()

    def _show(self, observation: Observation, on_published: OnPublished | None = None) -> None:
        self._phase, self._observation, self._answer = Phase.HELD, observation, None
        if on_published is not None:
            self._on_published.append(on_published)
        self._publish_if_heard()

    def _publish_if_heard(self) -> None:
        observation, is_new = self._observation, self._phase is Phase.HELD
        if observation is None or self._state is RunState.QUITTING:
            return
        if is_new and not self._publish.has_subscribers():
            return
        if is_new:
            self._phase = Phase.WAITING
        self._publish.observation(observation, is_new)
        self._tell_of(observation)

    def _tell_of(self, observation: Observation | None) -> None:
        callbacks, self._on_published = self._on_published, []
        for callback in callbacks:
            callback(observation)
