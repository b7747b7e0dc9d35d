"""Package my_controllers."""

from setuptools import setup

setup(
    name='my_controllers',
    version='0.1.0',
    packages=['my_controllers'],
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/my_controllers']),
        ('share/my_controllers', ['package.xml']),
    ],
    entry_points={
        'console_scripts': [
            'balance = spikelane_controllers.nodes.main:main',
            'learning_balance = spikelane_controllers.nodes.main:main',
            'metered = spikelane_controllers.nodes.main:main',
        ],
        'spikelane.controllers': [
            'balance = my_controllers.cards:BALANCE',
            'learning_balance = my_controllers.cards:LEARNING_BALANCE',
            'metered = my_controllers.cards:METERED',
        ],
    },
)
