"""What is loaded when a command starts: what is not needed must not take time."""

import json
from pathlib import Path
import subprocess
import sys

import pytest

from spikelane_benches.startup import measure_startup

#: Libraries that take time to load, or that only some commands use.
HEAVY = {
    'gymnasium', 'h5netcdf', 'h5py', 'jinja2', 'matplotlib', 'mcap', 'numba', 'pandas', 'PIL',
    'pybullet', 'rclpy', 'rich', 'rosbags', 'scipy', 'torch', 'yaml',
}  # fmt: skip

#: A program that prints which modules are loaded, and ends.
TELL = (
    'import json, os, sys\n'
    'def tell(*_):\n'
    '    os.write(1, json.dumps(sorted(sys.modules)).encode())\n'
    '    os._exit(0)\n'
)


def modules(code: str, *words: str) -> set[str]:
    """Return the modules that a program has loaded when it calls `tell`."""
    command = [sys.executable, '-c', TELL + code, *words]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
    start = done.stdout.rindex(b'["')
    return set(json.loads(done.stdout[start:]))


def packages(names: set[str]) -> set[str]:
    """Return the packages of modules."""
    return {name.partition('.')[0] for name in names}


def test_help_loads_no_library() -> None:
    """Not even NumPy: the list of commands is text."""
    code = 'import atexit; atexit.register(tell); from spikelane_entry import main; main()'
    found = packages(modules(code, '--help'))
    assert found & (HEAVY | {'numpy'}) == set()
    assert 'spikelane' in found


@pytest.mark.parametrize('robot', [('kinematic', set()), ('pybullet', {'pybullet'})])
def test_a_lap_loads_only_what_drives_before_its_loop(
    robot: tuple[str, set[str]], tmp_path: Path
) -> None:
    """Numba, which asks for SciPy's version; what writes and draws results comes afterwards."""
    engine, libraries = robot
    code = (
        'from spikelane.main import run\n'
        'from spikelane_sim.simulator import Simulator\n'
        'Simulator.step = tell\n'
        'run(sys.argv[1:])\n'
    )
    words = ['lap', '--transport', 'inprocess', '--engine', engine, '--out', str(tmp_path / 'lap')]
    found = modules(code, *words)
    assert packages(found) & HEAVY == {'numba', 'scipy', 'yaml'} | libraries
    assert 'scipy.linalg' not in found


def test_a_kernel_of_somebody_has_linear_algebra() -> None:
    """SciPy's BLAS is loaded by the first kernel that uses it."""
    code = (
        'import numba, numpy, spikelane\n'
        'from spikelane_sim.compiled import inner\n'
        'assert "scipy.linalg" not in sys.modules\n'
        'product = numba.njit(lambda a, b: (a @ b, numpy.linalg.solve(a, b)))\n'
        'a, b = numpy.array([[1.0, 2.0], [3.0, 4.0]]), numpy.array([5.0, 6.0])\n'
        'assert numpy.allclose(product(a, b), [[17, 39], [-4, 4.5]])\n'
        'tell()\n'
    )
    assert 'scipy.linalg.cython_blas' in modules(code)


def test_start_up_is_measured() -> None:
    """A lap takes longer to start than Numba, which it loads, and that longer than the help."""
    result = measure_startup(repeats=1)
    assert 0 < result['help_s'] < result['numba_s'] < result['lap_s']
    assert result['beyond_numba_s'] == pytest.approx(result['lap_s'] - result['numba_s'], abs=2e-3)
