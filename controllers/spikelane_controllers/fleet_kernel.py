"""What all controllers of a fleet have in common, compiled."""

from __future__ import annotations

from spikelane_sim.compiled import uncounted
from spikelane_sim.fleet.kernel import HEADING, X, Y


@uncounted
def write_down(robots, journey, i, left, right):  # type: ignore[no-untyped-def]
    """Write down an answer of robot i; return whether its episode goes on.

    Args:
        robots: The `Robots`.
        journey: The `Journey`; row i changes.
        i: Which robot.
        left: Velocity of the left wheel [rad/s].
        right: The same for the right wheel.
    """
    known, k = robots.known[i], journey.taken[i]
    journey.answers[i, k, 0], journey.answers[i, k, 1] = left, right
    if journey.places.shape[1] > 0:
        _write_place(journey.places[i, k], robots.motion[i], robots.poses[i, -1], known)
    if known.reason > 0:
        journey.has_ended[i] = True
        return False
    journey.distance_m[i] = known.distance_m
    journey.taken[i] = k + 1
    return True


@uncounted
def _write_place(place, motion, pose, known):  # type: ignore[no-untyped-def]
    """Write down where an observation was made, as a record of `PLACE_DTYPE`."""
    place['x_m'], place['y_m'], place['heading_rad'] = motion[X], motion[Y], motion[HEADING]
    place['orientation_x'], place['orientation_y'] = pose[3], pose[4]
    place['orientation_z'], place['orientation_w'] = pose[5], pose[6]
    place['distance_m'], place['heading_error_rad'] = known.distance_m, known.heading_error_rad
    place['position_m'], place['progress_m'] = known.position_m, known.progress_m
    place['section'], place['laps'], place['events'] = known.section, known.laps, known.n_events
