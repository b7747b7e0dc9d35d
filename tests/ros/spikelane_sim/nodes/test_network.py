"""Which network interfaces the nodes use: the loopback interface unless told otherwise."""

import os
from pathlib import Path
import re
import shutil
import subprocess

from domain_coordinator import domain_id
import pytest

from spikelane.executables import find_executable
from spikelane.nodes.domain import own_domain
from spikelane.nodes.graph import RECORDER_DEADLINE_S, running_nodes
from spikelane.runs.configuration import Request
from spikelane.runs.folder import RunFolder
from spikelane.runs.lap.config import LapConfig
from spikelane.runs.lap.nodes.driving import node_parameters
from spikelane_sim.errors import SpikelaneError
from spikelane_sim.nodes.network import network_variables

pytestmark = pytest.mark.ros

LOOPBACK = '127.0.0.1'
MULTICAST = '239.255.0.1'  # of DDS; joined on the loopback interface alone
NODES = ('recorder', 'simulator', 'braitenberg')
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def bound_addresses(pid: int) -> set[str]:
    """Return the local addresses of a process's UDP sockets, as `ss` or the kernel lists them."""
    if shutil.which('ss') is None:
        return _addresses_in_proc(pid)
    listed = subprocess.run(['ss', '-Huanp'], capture_output=True, text=True, check=True).stdout
    own = [line.split() for line in listed.splitlines() if f'pid={pid},' in line]
    return {fields[3].rpartition(':')[0] for fields in own}


def _addresses_in_proc(pid: int) -> set[str]:
    inodes = set()
    for descriptor in Path(f'/proc/{pid}/fd').iterdir():
        found = re.fullmatch(r'socket:\[(\d+)\]', os.readlink(descriptor))
        inodes |= {found[1]} if found else set()
    rows = [line.split() for line in Path('/proc/net/udp').read_text().splitlines()[1:]]
    own = [row[1].partition(':')[0] for row in rows if row[9] in inodes]
    return {'.'.join(str(byte) for byte in reversed(bytes.fromhex(each))) for each in own}


def addresses_of_a_lap(folder: Path) -> dict[str, set[str]]:
    """Drive as `lap` does; return the addresses that each node's sockets are bound to."""
    config = LapConfig.make(
        Request('1', 'braitenberg', 0, 'ros', {'simulator.robot.model': 'kinematic'}), 'outer'
    )
    run = RunFolder(folder)
    parameters = node_parameters(config, run, is_recorded=True)
    parameters['simulator']['autostart'] = True
    with running_nodes(parameters, run) as (processes, supervisor):
        supervisor.wait_for('a step', lambda: int(supervisor.values.get('steps', 0)) > 0)
        children = processes._children.items()
        return {name: bound_addresses(child.pid) for name, child in children}


def test_the_nodes_of_a_lap_use_the_loopback_interface_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The simulator, the controller and the recorder, while they drive."""
    monkeypatch.delenv('SPIKELANE_NETWORK', raising=False)
    addresses = addresses_of_a_lap(tmp_path)
    assert set(addresses) == set(NODES)
    assert all(LOOPBACK in each for each in addresses.values())
    assert set().union(*addresses.values()) <= {LOOPBACK, MULTICAST}


def test_all_interfaces_are_used_when_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """SPIKELANE_NETWORK=all: ROS's usual sockets."""
    monkeypatch.setenv('SPIKELANE_NETWORK', 'all')
    addresses = addresses_of_a_lap(tmp_path)
    assert set(addresses) == set(NODES)
    assert all('0.0.0.0' in each for each in addresses.values())


def test_single_nodes_find_each_other_on_the_loopback_interface(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Started one by one without any ROS or Spikelane variable but the domain, as `ros2 run`."""
    for name in (PROFILE, 'SPIKELANE_NETWORK', 'ROS_AUTOMATIC_DISCOVERY_RANGE'):
        monkeypatch.delenv(name, raising=False)
    steps = tmp_path / 'log'
    with domain_id() as domain, steps.open('wb') as log:
        environment = os.environ | {'ROS_DOMAIN_ID': str(domain)}
        commands = (
            ['braitenberg'],
            [
                'simulator',
                '--ros-args',
                '-p',
                'robot.model:=kinematic',
                '-p',
                'episode.max_steps:=50',
                '-p',
                'end_after_episodes:=1',
            ],
        )
        nodes = [
            subprocess.Popen(
                [str(find_executable(command[0])), *command[1:]],
                env=environment,
                stdout=log,
                stderr=log,
            )
            for command in commands
        ]
        try:
            assert nodes[1].wait(120) == 0
        finally:
            for node in nodes:
                node.kill()
                node.wait()
    assert 'ended after' in steps.read_text()


def test_a_profile_of_the_users_own_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ours, of an environment sourced before, are replaced by what is asked for now."""
    assert network_variables({PROFILE: '/home/me/mine.xml'}) == {}
    monkeypatch.setenv(PROFILE, '/home/me/mine.xml')
    with own_domain() as domain:
        assert domain.environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
        assert PROFILE not in domain.environment
    ours = network_variables({})[PROFILE]
    assert Path(ours).name == 'spikelane_loopback.xml'
    wide = network_variables({PROFILE: ours, 'SPIKELANE_NETWORK': 'all'})[PROFILE]
    assert Path(wide).name == 'spikelane_all.xml'


@pytest.mark.parametrize('network', ['loopback', 'all'])
def test_nodes_of_a_lap_outlast_a_stop_as_long_as_the_lap_waits(
    network: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recorder that others forget while it is stopped loses what they have sent to it."""
    monkeypatch.delenv(PROFILE, raising=False)
    monkeypatch.setenv('SPIKELANE_NETWORK', network)
    usual = Path(network_variables(os.environ)[PROFILE]).read_text()
    with own_domain() as domain:
        patient = Path(domain.environment[PROFILE]).read_text()
    lease = '<leaseDuration><sec>{}</sec></leaseDuration>'
    assert lease.format(900) in patient
    assert patient.replace(lease.format(900), lease.format(20)) == usual
    assert RECORDER_DEADLINE_S == 600.0


def test_an_unknown_network_is_refused() -> None:
    """By every node in one line."""
    with pytest.raises(
        SpikelaneError, match=r"^SPIKELANE_NETWORK: expected loopback or all, got 'x'$"
    ):
        network_variables({'SPIKELANE_NETWORK': 'x'})
    for node in NODES:
        done = subprocess.run(
            [str(find_executable(node))],
            env=os.environ | {'SPIKELANE_NETWORK': 'x'},
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 2
        assert done.stderr == "error: SPIKELANE_NETWORK: expected loopback or all, got 'x'\n"
