"""Transforms between frames that are not each other's parents."""

import math

import numpy as np
import pytest

from spikelane_sim.errors import SpikelaneError
from spikelane_sim.transform_tree import Transform, TransformTree

HALF = math.sqrt(0.5)
LEFT = (0.0, 0.0, HALF, HALF)  # a quarter turn about z


def test_transforms_are_chained_up_and_down() -> None:
    """From one branch to another: body to mast to camera, body to wheel."""
    tree = TransformTree()
    tree.add('body', 'mast', Transform((1.0, 0.0, 0.0), LEFT))
    tree.add('mast', 'camera', Transform((2.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0)))
    tree.add('body', 'wheel', Transform((0.0, -1.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    camera = tree.find('body', 'camera')
    assert camera is not None
    np.testing.assert_allclose(camera[:3, 3], (1.0, 2.0, 0.5), atol=1e-12)
    np.testing.assert_allclose(camera[:3, 0], (0.0, 1.0, 0.0), atol=1e-12)
    from_wheel = tree.find('wheel', 'camera')
    assert from_wheel is not None
    np.testing.assert_allclose(from_wheel[:3, 3], (1.0, 3.0, 0.5), atol=1e-12)
    assert tree.find('body', 'arm') is None


def test_a_loop_of_frames_ends() -> None:
    """Each is the other's parent: there is no way to anything else."""
    tree = TransformTree()
    tree.add('a', 'b', Transform((1.0, 0.0, 0.0), LEFT))
    tree.add('b', 'a', Transform((1.0, 0.0, 0.0), LEFT))
    assert tree.find('c', 'a') is None


@pytest.mark.parametrize(
    'transform',
    [
        Transform((math.nan, 0.0, 0.0), LEFT),
        Transform((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
    ],
)
def test_what_is_no_transform_is_refused(transform: Transform) -> None:
    """Not finite, or no rotation."""
    with pytest.raises(SpikelaneError, match='expected finite numbers and a quaternion'):
        TransformTree().add('a', 'b', transform)
