# SPDX-License-Identifier: Apache-2.0
import sys
from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'dbscan_reg_ros'
COMMANDS = ('compare', 'convert', 'demo', 'dump', 'play', 'register', 'replay', 'scan_matcher',
            'scan_matcher_lifecycle', 'simulate', 'tune')
ENTRY_POINT = f'{PACKAGE}.__main__:entry_point'

if {'install', 'develop'} & set(sys.argv):
    # colcon and bloom: the executables of ``ros2 run`` in lib/dbscan_reg_ros, as setup.cfg says.
    SCRIPTS = [f'{name} = {ENTRY_POINT}' for name in COMMANDS]
else:
    # pip: what it installs goes into bin, where names as common as these would hide those of others.
    SCRIPTS = [f'dbscan-reg-ros = {ENTRY_POINT}']

setup(
    name=PACKAGE,
    version='0.1.0',
    description='2D lidar odometry by registration of line segments with DBSCAN clustering',
    license='Apache-2.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', 'replays/*.html']},
    python_requires='>=3.10',
    install_requires=['numpy>=1.26', 'scipy>=1.11.4', 'scikit-learn>=1.4.1', 'PyYAML'],
    extras_require={'commands': ['matplotlib', 'rosbags', 'tqdm'], 'cluster': ['distributed'],
                    'tune': ['optuna'], 'test': ['hypothesis', 'pytest']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', glob('config/*')),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
    ],
    entry_points={'console_scripts': SCRIPTS},
    zip_safe=True,
)
