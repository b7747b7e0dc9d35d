"""Package spikelane_sim."""

from glob import glob

from setuptools import find_packages, setup

setup(
    name='spikelane_sim',
    version='0.1.0',
    packages=find_packages(),
    package_data={
        'spikelane_sim': ['py.typed', 'courses/*.yaml', 'robots/*.urdf', 'nodes/fastdds/*.xml']
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/spikelane_sim']),
        ('share/spikelane_sim', ['package.xml']),
        ('share/spikelane_sim/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='Spikelane developers',
    maintainer_email='spikelane@example.org',
    description='Lane-keeping simulator',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'simulator = spikelane_sim.nodes.simulator:main',
        ],
        'spikelane.robots': [
            'p3dx = spikelane_sim.robots.p3dx:P3DX',
            'turtlebot4 = spikelane_sim.robots.turtlebot4:TURTLEBOT4',
        ],
        'spikelane.engines': [
            'kinematic = spikelane_sim.robots.kinematic:ENGINE',
            'pybullet = spikelane_sim.robots.pybullet_engine:ENGINE',
        ],
    },
)
