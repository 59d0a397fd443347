"""The ROS package waychair_ros: entry points of the nodes for `ros2 run` and `ros2 launch`; the code is in waychair.

The page is not among them, since `waychair up` combines its node with the web server.
"""

from pathlib import Path

from setuptools import setup

NAME = "waychair_ros"
NODES = ("simulator", "bridge", "cells", "glove", "mapper", "navigator", "recorder")

setup(
    name=NAME,
    version="0.2.0",
    description="Entry points and a launch file for the nodes of waychair",
    license="Apache-2.0",
    packages=[],
    install_requires=["waychair"],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", sorted(str(path) for path in Path("launch").glob("*.launch.py"))),
    ],
    entry_points={"console_scripts": [f"{node} = waychair.ros.nodes.{node}_node:main" for node in NODES]},
)
