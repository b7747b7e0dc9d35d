"""Package spikelane_controllers."""

from glob import glob

from setuptools import find_packages, setup

setup(
    name='spikelane_controllers',
    version='0.1.0',
    packages=find_packages(),
    package_data={'spikelane_controllers': ['py.typed', '*/weights/*.safetensors']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/spikelane_controllers']),
        ('share/spikelane_controllers', ['package.xml']),
        ('share/spikelane_controllers/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools'],
    zip_safe=False,
    maintainer='Spikelane developers',
    maintainer_email='spikelane@example.org',
    description='Controllers for lane keeping',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'braitenberg = spikelane_controllers.nodes.main:main',
            'dqn = spikelane_controllers.nodes.main:main',
            'rstdp = spikelane_controllers.nodes.main:main',
            'dqn_snn = spikelane_controllers.nodes.main:main',
        ],
        'spikelane.controllers': [
            'braitenberg = spikelane_controllers.braitenberg.card:CARD',
            'rstdp = spikelane_controllers.rstdp.card:CARD',
            'dqn = spikelane_controllers.dqn.card:CARD',
            'dqn_snn = spikelane_controllers.dqn_snn.card:CARD',
        ],
    },
)
