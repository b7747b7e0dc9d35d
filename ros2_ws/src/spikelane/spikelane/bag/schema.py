"""Message definitions as bags carry them: a type's text with the texts of all it is made of.

The layout is that of rosbag2: the root's text, then every dependency once, depth first in
alphabetical order, under a line of 80 `=` and its name.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import re
from typing import NamedTuple

_SEPARATOR = '=' * 80
# A field's type at the start of a line: `Header`, `std_msgs/Header`, `Point32[<=3]`.
_MSG_FIELD = re.compile(r'^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[A-Za-z]', re.MULTILINE)
_IDL_INCLUDE = re.compile(r'^\s*#include\s+"(\w+)/(\w+)/(\w+)\.idl"', re.MULTILINE)
_PRIMITIVE = re.compile(r'bool|byte|char|u?int(8|16|32|64)|float(32|64)|w?string')

ShareFolder = Callable[[str], Path]


class Schema(NamedTuple):
    """The definition of a type; both texts are empty where none is installed."""

    encoding: str
    text: str


def collect_schema(type_name: str, share_of: ShareFolder) -> Schema:
    """Return the definition of a type with all its dependencies.

    Args:
        type_name: `package/msg/Type`.
        share_of: Gives the share folder of an installed package; raises LookupError for others.

    Returns:
        `ros2msg` text; `ros2idl` text where one of the .msg files is not installed; empty texts
        where those are missing too, as rosbag2 records types it does not know.
    """
    package, _, name = type_name.partition('/msg/')
    if not package or not name:
        return Schema('', '')
    for encoding, collect in (('ros2msg', _collect_msg), ('ros2idl', _collect_idl)):
        try:
            return Schema(encoding, collect(package, name, share_of))
        except (OSError, LookupError, UnicodeDecodeError):
            continue
    return Schema('', '')


def _collect_msg(package: str, name: str, share_of: ShareFolder) -> str:
    parts: list[str] = []
    seen = {(package, name)}

    def visit(package: str, name: str, heading: str) -> None:
        text = _read(share_of(package) / 'msg' / f'{name}.msg')
        parts.append(heading + text)
        for dependency in sorted(_msg_dependencies(package, text)):
            if dependency not in seen:
                seen.add(dependency)
                visit(*dependency, f'\n{_SEPARATOR}\nMSG: {"/".join(dependency)}\n')

    visit(package, name, '')
    return ''.join(parts)


def _msg_dependencies(package: str, text: str) -> set[tuple[str, str]]:
    code = re.sub(r'#.*', '', text)
    dependencies = set()
    for field_type in _MSG_FIELD.findall(code):
        if _PRIMITIVE.fullmatch(field_type):
            continue
        *owner, name = field_type.split('/')
        dependencies.add((owner[0] if owner else package, name))
    return dependencies


def _collect_idl(package: str, name: str, share_of: ShareFolder) -> str:
    parts: list[str] = []
    seen = {(package, 'msg', name)}

    def visit(package: str, folder: str, name: str) -> None:
        text = _read(share_of(package) / folder / f'{name}.idl')
        parts.append(f'{_SEPARATOR}\nIDL: {package}/{folder}/{name}\n{text}')
        for dependency in sorted(set(_IDL_INCLUDE.findall(text))):
            if dependency not in seen:
                seen.add(dependency)
                visit(*dependency)

    visit(package, 'msg', name)
    return '\n'.join(parts)


def _read(path: Path) -> str:
    # Line endings stay as they are: the text is the definition.
    return path.read_bytes().decode()
