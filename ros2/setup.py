"""For colcon (ament_python). The package `tendril` itself comes by `pip install ./python` of this checkout."""

from setuptools import setup

NAME = "tendril_ros2"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/tendril.launch.py"]),
    ],
    install_requires=["setuptools", "tendril"],
    zip_safe=True,
    description="A tendon-driven continuum robot that tendrild controls, as topics and services",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"bridge = {NAME}.bridge:main"]},
)
