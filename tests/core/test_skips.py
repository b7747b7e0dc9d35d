"""Tests may be skipped for a few reasons only, and only so many of them."""

from pathlib import Path
import shutil
import subprocess
import sys

import pytest

CONFTEST = Path(__file__).parents[1] / 'conftest.py'


@pytest.mark.parametrize(
    ('reasons', 'status'),
    [
        (['ROS launch is not installed'], 0),
        (['ROS launch is not installed'] * 3, 1),
        (['no Chromium'], 1),
        (['mounting is not permitted here', 'no network'], 1),
    ],
)
def test_a_skip_that_is_not_allowed_fails_the_tests(
    tmp_path: Path, reasons: list[str], status: int
) -> None:
    """It is named at the end, with its place."""
    shutil.copy(CONFTEST, tmp_path)
    tests = [
        f'@pytest.mark.skip(reason={reason!r})\ndef test_{number}(): pass\n'
        for number, reason in enumerate(reasons)
    ]
    (tmp_path / 'test_some.py').write_text('import pytest\n\n' + '\n'.join(tests))
    command = [sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stdout
    said = f': {reasons[-1]}' in done.stdout
    assert said == (status == 1)
