"""What a stepper has been asked for: the command that holds, and steps of a paused simulation."""

from __future__ import annotations

from collections.abc import Callable

from spikelane_sim.contract import STANDSTILL, WheelVelocities


class HeldCommand:
    """The last command, which holds where steps do not wait for an answer."""

    def __init__(self, hold_ns: int | None, period_ns: int) -> None:
        """Begin at a standstill.

        Args:
            hold_ns: How long a command holds [ns of simulation time], at least for one step; None
                for ever.
            period_ns: Length of a step.
        """
        self._hold_ns = None if hold_ns is None else max(hold_ns, period_ns)
        self._wheels, self._given_ns = STANDSTILL, 0

    def give(self, wheels: WheelVelocities, now_ns: int) -> None:
        """Hold a command from now on."""
        self._wheels, self._given_ns = wheels, now_ns

    def replace(self, wheels: WheelVelocities) -> None:
        """Hold another command, for as long as the one before."""
        self._wheels = wheels

    def begin_time_again(self) -> None:
        """Let the command hold as if it was given at time 0."""
        self._given_ns = 0

    def wheels(self, now_ns: int) -> WheelVelocities:
        """Return what the wheels are to do now."""
        is_fresh = self._hold_ns is None or now_ns - self._given_ns < self._hold_ns
        return self._wheels if is_fresh else STANDSTILL


class RequestedSteps:
    """A number of steps asked for while the simulation is paused."""

    def __init__(self, steps: int, on_step: Callable[[int, bool], None]) -> None:
        """Begin with none taken; see `Stepper.advance`."""
        self._steps, self._taken, self._on_step = steps, 0, on_step
        self._is_over = False

    def count(self, is_running: bool) -> bool:
        """Count a step that was taken.

        Args:
            is_running: Whether the episode goes on after it.

        Returns:
            Whether no more will be taken.
        """
        self._taken += 1
        self._is_over = self._taken >= self._steps or not is_running
        return self._is_over

    def cancel(self) -> None:
        """Tell that no more will be taken."""
        self._is_over = True
        self.tell()

    def tell(self) -> None:
        """Tell how many steps were taken, and whether no more will be."""
        self._on_step(self._taken, self._is_over)
