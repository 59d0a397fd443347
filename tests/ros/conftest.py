"""Real processes over real DDS, each test session in a ROS domain of its own; without ROS these tests are skipped."""

from __future__ import annotations

import fcntl
import importlib.util
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.ros.harness import Harness


@pytest.fixture(scope="session")
def ros_domain() -> Iterator[int]:
    """A domain that no other session of tests on this computer uses."""
    if importlib.util.find_spec("rclpy") is None:
        pytest.skip(
            "ROS is not installed (no rclpy): pip install 'waychair[ros]' on x86_64, or source ROS's setup.bash"
        )
    for domain in range(1, 102):
        with Path(tempfile.gettempdir(), f"waychair-test-domain-{domain}").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            yield domain
            return
    pytest.fail("all ROS domains are taken by other test sessions")


@pytest.fixture(scope="session")
def ros(ros_domain: int) -> Iterator[Harness]:
    """This process as a member of that domain."""
    before = dict(os.environ)
    from waychair.ros.environment import enter_ros_environment

    enter_ros_environment(domain=ros_domain)
    from tests.ros.harness import Harness

    with Harness(ros_domain) as harness:
        yield harness
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture(autouse=True)
def one_ros_test(request: pytest.FixtureRequest) -> Iterator[None]:
    """Each test that uses the session's node leaves nothing on it."""
    if "ros" not in request.fixturenames:
        yield
        return
    harness: Harness = request.getfixturevalue("ros")
    with harness.one_test():
        yield
