"""Recordings of events that are no rosbag2 bags: what they are, and how to convert them.

Sources: file headers of ROS (http://wiki.ros.org/Bags/Format/2.0), Prophesee
(https://docs.prophesee.ai/stable/data/file_formats/index.html), iniVation
(https://docs.inivation.com/software/software-advanced-usage/file-formats) and HDF5; converters of
https://github.com/ros-event-camera/event_camera_tools and https://pypi.org/project/rosbags.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import NamedTuple

_RAW_TO_BAG = (
    'ros2 run event_camera_tools raw_to_bag -i FILE -b BAG -t /event_camera/events -w WIDTH '
    '-h HEIGHT'
)


class _Format(NamedTuple):
    """A format by how its files begin and end; an empty beginning is that of any file."""

    head: bytes
    endings: tuple[str, ...]
    meaning: str


_FORMATS = (
    _Format(
        b'#ROSBAG V',
        (),
        'a ROS 1 bag: convert it with rosbags-convert --src FILE --dst FOLDER, which comes with '
        'rosbags',
    ),
    _Format(
        b'% ',
        ('.dat',),
        'a DAT file of Prophesee, which has decoded events: convert the RAW file that it was made '
        f'of with {_RAW_TO_BAG}',
    ),
    _Format(b'% ', (), f'a RAW file of Prophesee: convert it (EVT3) with {_RAW_TO_BAG}'),
    _Format(
        b'#!AER-DAT',
        (),
        'an AEDAT file of iniVation: no converter to rosbag2 is known; record the camera with '
        'libcaer_driver, or read the file with the Python package aedat and write EventPackets',
    ),
    _Format(
        b'\x89HDF\r\n\x1a\n',
        (),
        'an HDF5 file, which has decoded events: convert the RAW file of Prophesee that it was '
        f'made of with {_RAW_TO_BAG}',
    ),
    _Format(
        b'\x04\x22\x4d\x18',
        (),
        'a file compressed by lz4: decompress it first, with lz4 -d',
    ),
    _Format(b'\x1f\x8b', (), 'a file compressed by gzip: decompress it first, with gunzip'),
    _Format(b'PK\x03\x04', (), 'a ZIP archive: unpack it first, with unzip'),
    _Format(
        b'',
        ('.raw',),
        f'a file named like a RAW file of Prophesee: convert it (EVT3) with {_RAW_TO_BAG}',
    ),
)
_LEGACY = (
    '; ros2 run event_camera_legacy_tools legacy_to_bag converts dvs_msgs and prophesee_event_msgs'
)


def foreign_format(name: str, head: bytes) -> str:
    """Return what a file is and how to convert it, '' where it is none of these.

    Args:
        name: The file's.
        head: Its first bytes.
    """
    ending = PurePosixPath(name).suffix.lower()
    for each in _FORMATS:
        if head.startswith(each.head) and (not each.endings or ending in each.endings):
            return each.meaning
    return ''


def legacy_hint(type_names: frozenset[str]) -> str:
    """Return how to convert messages of older types of events, '' where there are none."""
    packages = {name.partition('/')[0] for name in type_names}
    return _LEGACY if packages & {'dvs_msgs', 'prophesee_event_msgs'} else ''
