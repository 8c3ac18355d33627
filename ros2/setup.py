"""For colcon (ament_python). The package `tendril` itself comes by `pip install ./python` of this checkout."""

from xml.etree import ElementTree

from setuptools import setup

PACKAGE = {part.tag: part.text for part in ElementTree.parse("package.xml").getroot()}
NAME = PACKAGE["name"]

setup(
    name=NAME,
    version=PACKAGE["version"],
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/tendril.launch.py"]),
    ],
    install_requires=["setuptools", "tendril"],
    zip_safe=True,
    description=PACKAGE["description"],
    license=PACKAGE["license"],
    entry_points={"console_scripts": [f"bridge = {NAME}.bridge:main"]},
)
