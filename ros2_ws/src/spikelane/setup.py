"""Package spikelane."""

from glob import glob

from setuptools import find_packages, setup

setup(
    name='spikelane',
    version='0.1.0',
    packages=find_packages(),
    package_data={
        'spikelane': ['py.typed'],
        'spikelane.experiment': ['*.yaml'],
        'spikelane.report': ['page.html'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/spikelane']),
        ('share/spikelane', ['package.xml']),
        ('share/spikelane/config', glob('config/*.*')),
        ('share/spikelane/launch', glob('launch/*.launch.py')),
    ],
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='Spikelane developers',
    maintainer_email='spikelane@example.org',
    description='Lane-keeping experiment',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'spikelane = spikelane.entry:main',
            'recorder = spikelane.nodes.recorder:main',
            'replay = spikelane.runs.replay.nodes.replay:main',
            'viewer = spikelane.nodes.viewer:main',
            'wheels_to_twist = spikelane.nodes.wheels_to_twist:main',
        ],
    },
)
