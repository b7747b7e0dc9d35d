"""How pybullet is imported."""

import subprocess
import sys

IMPORT = 'import spikelane_sim.robots.bullet_drive, os; os.write(2, b"said\\n")'


def test_pybullet_does_not_tell_its_build_time() -> None:
    """Standard error carries what others write, before and after."""
    done = subprocess.run([sys.executable, '-c', IMPORT], capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b'', b'said\n')


def test_pybullet_is_imported_without_a_standard_error() -> None:
    """Daemons close it."""
    command = f"exec '{sys.executable}' -c 'import spikelane_sim.robots.bullet_drive' 2>&-"
    subprocess.run(['bash', '-c', command], check=True)
