from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'dbscan_reg_ros'

setup(
    name=PACKAGE,
    version='0.1.0',
    description='2D lidar odometry by registration of line segments with DBSCAN clustering',
    license='Apache-2.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['replays/*.html']},
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
    entry_points={'console_scripts': [
        f'compare = {PACKAGE}.commands.compare:main',
        f'convert = {PACKAGE}.commands.convert:main',
        f'demo = {PACKAGE}.commands.demo:main',
        f'dump = {PACKAGE}.commands.dump:main',
        f'play = {PACKAGE}.commands.play:main',
        f'register = {PACKAGE}.commands.register:main',
        f'replay = {PACKAGE}.commands.replay:main',
        f'simulate = {PACKAGE}.commands.simulate:main',
        f'scan_matcher = {PACKAGE}.node.scan_matcher:main',
        f'scan_matcher_lifecycle = {PACKAGE}.node.scan_matcher_lifecycle:main',
        f'tune = {PACKAGE}.commands.tune:main',
    ]},
    zip_safe=True,
)
