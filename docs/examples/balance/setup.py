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
            'balance = my_controllers.balance_node:main',
            'learning_balance = my_controllers.learning_balance_node:main',
        ],
        'spikelane.controllers': [
            'balance = my_controllers.balance:Balance',
            'learning_balance = my_controllers.learning_balance:LearningBalance',
        ],
        'spikelane.trainings': ['learning_balance = spikelane_controllers.training:Training'],
    },
)
