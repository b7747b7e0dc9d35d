"""Kernels that draw the ground's markings into an image, scanline by scanline.

Ray casting turned round: along one image row the rays of a pinhole camera meet the ground in a
straight line, on which a piece of marking (`ground.py`) covers an interval whose ends follow in
closed form. Image and ground are tied by homogeneous coordinates (X, Y, W), each linear in the
image coordinates u, v: the ray through (u, v) meets the ground at (X / W, Y / W), and 1 / W is the
depth of that point along the optical axis. Hence a half-plane of the ground becomes a half-plane
of the image, and a circle a conic.

Without anti-aliasing a pixel has the intensity at its centre, exactly. With it, a pixel is the
average over `n_rows` scanlines within the pixel's row, along each of which the covered length is
exact.

numba keeps compiled kernels until their own file changes, so the layouts they rely on are here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from spikelane_sim.compiled import inlined, uncounted
from spikelane_sim.kernel_arrays import stack_array

Array = NDArray[np.float64]
Image = NDArray[np.float32]

# Columns of a piece: whether it is in a turn; centre and radius of a circle around it [m]; four
# half-planes a x + b y + c >= 0 with (a, b) a unit vector, the ends' first, then the sides' on a
# straight; in a turn, instead of the sides, centre x, y, inner and outer radius; and the corners
# of a convex polygon around it [m].
IS_ARC, AROUND, HALF_PLANES, ARC, CORNERS = 0, 1, 4, 10, 16
N_CORNERS = 5
N_COLUMNS = CORNERS + 2 * N_CORNERS

# The lens: focal lengths and principal point [px]; clipping depths [m]; place in the body frame
# [m]; sine and cosine of the pitch; intensity of the background; sine and cosine of the yaw.
FX, FY, CX, CY, NEAR, FAR, PLACE, PITCH_SIN, PITCH_COS, BACKGROUND = 0, 1, 2, 3, 4, 5, 6, 9, 10, 11
YAW_SIN, YAW_COS = 12, 13
N_LENS = 14

# A view: rows are the camera's axes (right, down, forward) and its place in the world.
RIGHT, DOWN, FORWARD, EYE = range(4)

# A homography: rows are the coefficients of X, Y and W for u, v and 1.
_X, _Y, _W = range(3)


class Scan(NamedTuple):
    """What bounds the interval that a piece covers on a scanline, as a function of v.

    Attributes:
        lower: The interval begins at or after slope * v + intercept, (6, 2).
        upper: The interval ends at or before slope * v + intercept, (6, 2).
        n: How many of the lower and upper bounds count, (2,).
        conic: X, Y relative to the circles' centre, and W, as in a homography, (3, 3).
        squared: Squares of the inner and outer radius [m^2], both 0 on a straight, (2,).
    """

    lower: Array
    upper: Array
    n: NDArray[np.int64]
    conic: Array
    squared: Array


@inlined
def empty_scan():  # type: ignore[no-untyped-def]
    """Return a `Scan` on the stack of the caller."""
    return Scan(
        stack_array((6, 2), np.float64),
        stack_array((6, 2), np.float64),
        stack_array((2,), np.int64),
        stack_array((3, 3), np.float64),
        stack_array((2,), np.float64),
    )


@numba.njit(cache=True, error_model='numpy')
def render(
    pieces: Array,
    floor: float,
    marking: float,
    lens: Array,
    pose: Array,
    n_rows: int,
    image: Image,
) -> bool:
    """Draw what the camera sees; return False, and draw nothing, for a pose that is not finite.

    Args:
        pieces: Markings, see above, (n_pieces, 26).
        floor: Intensity of the floor.
        marking: Intensity of the markings.
        lens: The camera, see above, (14,).
        pose: Pose of the body: x, y, z [m], quaternion x, y, z, w, (7,).
        n_rows: Scanlines per row of pixels; 1 for no anti-aliasing.
        image: Is overwritten, (H, W).
    """
    background = lens[BACKGROUND]
    image[:] = background
    view, ground = stack_array((4, 3), np.float64), stack_array((3, 3), np.float64)
    find_view(lens, pose, view)
    if not np.isfinite(np.sum(view)):
        return False
    if view[EYE, 2] <= 0.0:
        return True  # below the floor
    find_homography(lens, view, ground)
    scan = empty_scan()
    if floor != background:
        clip_depth(scan, ground, lens)
        _draw(scan, 0, image.shape[0], n_rows, floor, background, image)
    found = stack_array((128,), np.int64)
    for begin in range(0, len(pieces), len(found)):
        some = pieces[begin : begin + len(found)]
        for i in found[: find_pieces(some, view, lens, image.shape[1], found)]:
            first, last = rows_of(some[i], view, lens, image.shape[0], image.shape[1])
            if first < last:
                clip_depth(scan, ground, lens)
                clip_piece(scan, ground, some[i])
                _draw(scan, first, last, n_rows, marking, floor, image)
    if n_rows > 1:
        _limit(image, min(background, floor, marking), max(background, floor, marking))
    return True


@uncounted(error_model='numpy')
def find_view(lens: Array, pose: Array, view: Array) -> None:
    """Find the camera's axes and place in the world, (4, 3)."""
    x, y, z, w = pose[3], pose[4], pose[5], pose[6]
    two = 2.0 / (x * x + y * y + z * z + w * w)
    ahead = (1.0 - two * (y * y + z * z), two * (x * y + z * w), two * (x * z - y * w))
    left = (two * (x * y - z * w), 1.0 - two * (x * x + z * z), two * (y * z + x * w))
    up = (two * (x * z + y * w), two * (y * z - x * w), 1.0 - two * (x * x + y * y))
    for i in range(3):
        turned = lens[YAW_COS] * ahead[i] + lens[YAW_SIN] * left[i]
        view[RIGHT, i] = lens[YAW_SIN] * ahead[i] - lens[YAW_COS] * left[i]
        view[DOWN, i] = -lens[PITCH_SIN] * turned - lens[PITCH_COS] * up[i]
        view[FORWARD, i] = lens[PITCH_COS] * turned - lens[PITCH_SIN] * up[i]
        view[EYE, i] = (
            pose[i] + lens[PLACE] * ahead[i] + lens[PLACE + 1] * left[i] + lens[PLACE + 2] * up[i]
        )


@uncounted(error_model='numpy')
def find_homography(lens: Array, view: Array, ground: Array) -> None:
    """Find the coefficients of X, Y, W for u, v and 1, (3, 3)."""
    for i in range(3):
        u, v = view[RIGHT, i] / lens[FX], view[DOWN, i] / lens[FY]
        ground[i, 0], ground[i, 1] = u, v
        ground[i, 2] = view[FORWARD, i] - lens[CX] * u - lens[CY] * v
    # The ray's height over the floor falls from that of the eye to 0 at depth 1 / W.
    for j in range(3):
        ground[_W, j] /= -view[EYE, 2]
        ground[_X, j] += view[EYE, 0] * ground[_W, j]
        ground[_Y, j] += view[EYE, 1] * ground[_W, j]


@uncounted(error_model='numpy')
def find_pieces(
    pieces: Array, view: Array, lens: Array, width: int, found: NDArray[np.int64]
) -> int:
    """Find the pieces whose circles reach into what the camera sees; return how many.

    Args:
        pieces: Markings.
        view: The view.
        lens: The lens.
        width: Columns of the image.
        found: Room for the numbers of all pieces.
    """
    fx, cx, near, far = lens[FX], lens[CX], lens[NEAR], lens[FAR]
    x, y, z = view[EYE, 0], view[EYE, 1], view[EYE, 2]
    ahead_x, ahead_y, ahead_z = view[FORWARD, 0], view[FORWARD, 1], view[FORWARD, 2]
    right_x, right_y, right_z = view[RIGHT, 0], view[RIGHT, 1], view[RIGHT, 2]
    # Squares of the lengths of the normals of the planes through the eye and the image's sides.
    from_left, from_right = fx * fx + cx * cx, fx * fx + (width - cx) * (width - cx)
    number = 0
    for i in range(pieces.shape[0]):
        dx, dy, radius = pieces[i, AROUND] - x, pieces[i, AROUND + 1] - y, pieces[i, AROUND + 2]
        depth = ahead_x * dx + ahead_y * dy - ahead_z * z
        if depth - radius > far or depth + radius < near:
            continue
        across = fx * (right_x * dx + right_y * dy - right_z * z)
        left, right = across + cx * depth, (width - cx) * depth - across
        squared = radius * radius
        if left < 0.0 and left * left > squared * from_left:
            continue
        if right < 0.0 and right * right > squared * from_right:
            continue
        found[number] = i
        number += 1
    return number


@uncounted(error_model='numpy')
def rows_of(piece: Array, view: Array, lens: Array, height: int, width: int) -> tuple[int, int]:
    """Return the range of rows that a piece can be seen in, empty where it is out of sight."""
    forward = view[FORWARD]
    near, far, left, right = True, True, True, True
    top, bottom, straddles = np.inf, -np.inf, False
    for i in range(CORNERS, CORNERS + 2 * N_CORNERS, 2):
        dx, dy, dz = piece[i] - view[EYE, 0], piece[i + 1] - view[EYE, 1], -view[EYE, 2]
        depth = dx * forward[0] + dy * forward[1] + dz * forward[2]
        u = dx * view[RIGHT, 0] + dy * view[RIGHT, 1] + dz * view[RIGHT, 2]
        u = lens[FX] * u + lens[CX] * depth
        v = dx * view[DOWN, 0] + dy * view[DOWN, 1] + dz * view[DOWN, 2]
        v = lens[FY] * v + lens[CY] * depth
        near &= depth < lens[NEAR]
        far &= depth > lens[FAR]
        left &= u < 0.0
        right &= u > width * depth
        if depth < lens[NEAR]:
            straddles = True
        else:
            top, bottom = min(top, v / depth), max(bottom, v / depth)
    if near or far or left or right:
        return 0, 0
    if straddles:
        return 0, height
    # One row more on either side takes care of rounding.
    return int(min(max(top - 1.0, 0.0), height)), int(max(min(bottom + 2.0, height), 0.0))


@uncounted(error_model='numpy')
def clip_depth(scan: Scan, ground: Array, lens: Array) -> None:
    """Begin a scan: what is between the clipping planes."""
    scan.n[:] = 0
    scan.squared[:] = 0.0
    w = ground[_W]
    _bound(scan, w[0], w[1], w[2] - 1.0 / lens[FAR])
    _bound(scan, -w[0], -w[1], 1.0 / lens[NEAR] - w[2])


@uncounted(error_model='numpy')
def _bound(scan: Scan, a: float, b: float, c: float) -> None:
    """Bound the scan by a u + b v + c >= 0."""
    if a == 0.0:
        a = 1e-300  # all of a scanline or nothing: a bound beyond any image
    which = 0 if a > 0.0 else 1
    bounds = scan.lower if a > 0.0 else scan.upper
    bounds[scan.n[which], 0] = -b / a
    bounds[scan.n[which], 1] = -c / a
    scan.n[which] += 1


@uncounted(error_model='numpy')
def clip_piece(scan: Scan, ground: Array, piece: Array) -> None:
    """Bound the scan by the edges of a piece."""
    is_arc = piece[IS_ARC] != 0.0
    for i in range(HALF_PLANES, ARC if is_arc else CORNERS, 3):
        a, b, c = piece[i], piece[i + 1], piece[i + 2]
        _bound(
            scan,
            a * ground[_X, 0] + b * ground[_Y, 0] + c * ground[_W, 0],
            a * ground[_X, 1] + b * ground[_Y, 1] + c * ground[_W, 1],
            a * ground[_X, 2] + b * ground[_Y, 2] + c * ground[_W, 2],
        )
    if is_arc:
        for j in range(3):
            scan.conic[_X, j] = ground[_X, j] - piece[ARC] * ground[_W, j]
            scan.conic[_Y, j] = ground[_Y, j] - piece[ARC + 1] * ground[_W, j]
            scan.conic[_W, j] = ground[_W, j]
        scan.squared[0] = piece[ARC + 2] ** 2
        scan.squared[1] = piece[ARC + 3] ** 2


@uncounted(error_model='numpy')
def _draw(
    scan: Scan, first: int, last: int, n_rows: int, inside: float, outside: float, image: Image
) -> None:
    """Draw a scan into rows first to last of the image, over what is `outside` so far."""
    width = float(image.shape[1])
    for row in range(first, last):
        for k in range(n_rows):
            v = row + (k + 0.5) / n_rows
            begin, end = between_bounds(scan, v, width)
            if not begin < end:
                continue
            if scan.squared[1] == 0.0:
                _fill(image, row, begin, end, n_rows, inside, outside)
                continue
            low, high = within_circle(scan, v, scan.squared[1])
            begin, end = max(begin, low), min(end, high)
            low, high = within_circle(scan, v, scan.squared[0])
            _fill(image, row, begin, min(end, low), n_rows, inside, outside)
            _fill(image, row, max(begin, high, low), end, n_rows, inside, outside)


@uncounted(error_model='numpy')
def between_bounds(scan: Scan, v: float, width: float) -> tuple[float, float]:
    """Return the interval of u between the straight bounds at height v."""
    begin, end = 0.0, width
    for i in range(scan.n[0]):
        begin = max(begin, scan.lower[i, 0] * v + scan.lower[i, 1])
    for i in range(scan.n[1]):
        end = min(end, scan.upper[i, 0] * v + scan.upper[i, 1])
    return begin, end


@uncounted(error_model='numpy')
def within_circle(scan: Scan, v: float, squared: float) -> tuple[float, float]:
    """Return the interval of u where X^2 + Y^2 <= squared W^2 in front of the camera.

    Where there is none it is (inf, inf): everything is before it.
    """
    x, y, w = scan.conic[_X], scan.conic[_Y], scan.conic[_W]
    x_0, y_0, w_0 = x[1] * v + x[2], y[1] * v + y[2], w[1] * v + w[2]
    a = x[0] * x[0] + y[0] * y[0] - squared * w[0] * w[0]
    b = x[0] * x_0 + y[0] * y_0 - squared * w[0] * w_0
    c = x_0 * x_0 + y_0 * y_0 - squared * w_0 * w_0
    discriminant = b * b - a * c
    if not discriminant > 0.0:
        return np.inf, np.inf
    q = -(b + math.copysign(math.sqrt(discriminant), b))
    u_1, u_2 = q / a, c / q
    low, high = min(u_1, u_2), max(u_1, u_2)
    if a > 0.0:
        return low, high
    # The scanline meets the horizon outside the circle, between its two roots.
    return (high, np.inf) if w[0] > 0.0 else (-np.inf, low)


@uncounted(error_model='numpy')
def _fill(
    image: Image, row: int, begin: float, end: float, n_rows: int, inside: float, outside: float
) -> None:
    """Paint from begin to end [px]: centres of pixels, or by the length covered."""
    if not begin < end:
        return
    if n_rows == 1:
        for i in range(math.ceil(begin - 0.5), math.ceil(end - 0.5)):
            image[row, i] = inside
        return
    weight = (inside - outside) / n_rows
    first, last = int(begin), int(end)
    if first == last:
        image[row, first] += weight * (end - begin)
        return
    image[row, first] += weight * (first + 1 - begin)
    for i in range(first + 1, last):
        image[row, i] += weight
    if last < image.shape[1]:
        image[row, last] += weight * (end - last)


@uncounted(error_model='numpy')
def _limit(image: Image, low: float, high: float) -> None:
    """Take back what markings that overlap added twice, and rounding."""
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            image[i, j] = min(max(image[i, j], low), high)


@numba.njit(cache=True, error_model='numpy')
def render_many(
    pieces: Array, floor: float, marking: float, lens: Array, poses: Array, n_rows: int, out: Image
) -> bool:
    """Do what `render` does for each of n poses (n, 7), into out (n, H, W)."""
    finite = True
    for i in range(poses.shape[0]):
        finite &= render(pieces, floor, marking, lens, poses[i], n_rows, out[i])
    return finite


@numba.njit(cache=True, error_model='numpy')
def are_painted(pieces: Array, x: Array, y: Array) -> NDArray[np.bool_]:
    """Tell for each of N points whether a marking is there; all arrays are (N,)."""
    painted = np.zeros(x.shape[0], np.bool_)
    for i in range(x.shape[0]):
        for j in range(pieces.shape[0]):
            if _is_inside(pieces[j], x[i], y[i]):
                painted[i] = True
                break
    return painted


@uncounted(error_model='numpy')
def _is_inside(piece: Array, x: float, y: float) -> bool:
    dx, dy = x - piece[AROUND], y - piece[AROUND + 1]
    if dx * dx + dy * dy > piece[AROUND + 2] * piece[AROUND + 2]:
        return False
    n_planes = 2 if piece[IS_ARC] else 4
    for i in range(HALF_PLANES, HALF_PLANES + 3 * n_planes, 3):
        if piece[i] * x + piece[i + 1] * y + piece[i + 2] < 0.0:
            return False
    if piece[IS_ARC]:
        dx, dy = x - piece[ARC], y - piece[ARC + 1]
        squared = dx * dx + dy * dy
        return bool(piece[ARC + 2] ** 2 <= squared <= piece[ARC + 3] ** 2)
    return True
