"""Messages without a wheel: built on this computer, with the same bytes as ROS's own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from waychair.errors import InterfaceBuildError, OutputError
from waychair.ros.interface_builder import built_interfaces
from waychair.ros.interface_types import interface_type

if TYPE_CHECKING:
    from tests.ros.harness import Harness

TF_HASH = "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
"""Of tf2_msgs/msg/TFMessage, as `ros2 topic info --verbose` prints it on an installed Jazzy."""


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ros: Harness) -> Path:
    """Definitions that are quick to build, and an empty cache."""
    definition = tmp_path / "texts" / "small_msgs" / "msg" / "Small.msg"
    definition.parent.mkdir(parents=True)
    definition.write_text("# one number\nint32 count\nfloat64[] values\n")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "texts"


def test_transforms_and_navigation_have_the_types_and_hashes_of_ros(ros: Harness) -> None:
    feedback = interface_type("nav2_msgs/action/NavigateToPose").Impl.FeedbackMessage
    for name, kind in (("types/tf", interface_type("tf2_msgs/msg/TFMessage")), ("types/feedback", feedback)):
        ros.node.create_publisher(kind, name, 1)

    def info(name: str) -> tuple[str, str]:
        ros.spin_until(lambda: ros.node.get_publishers_info_by_topic(name), name)
        (found,) = ros.node.get_publishers_info_by_topic(name)
        return found.topic_type, str(found.topic_type_hash)

    assert info("types/tf") == ("tf2_msgs/msg/TFMessage", TF_HASH)
    kind, digest = info("types/feedback")
    assert kind == "nav2_msgs/action/NavigateToPose_FeedbackMessage"
    assert digest.startswith("RIHS01_9d1f6fa2")
    assert digest.endswith("82b3")


def test_transforms_reach_another_process(ros: Harness) -> None:
    script = """
import rclpy
from waychair.ros.interface_types import interface_type
from geometry_msgs.msg import TransformStamped
rclpy.init()
node = rclpy.create_node("transforms")
publisher = node.create_publisher(interface_type("tf2_msgs/msg/TFMessage"), "/tf", 10)
stamped = TransformStamped()
stamped.child_frame_id = "moved"
node.create_timer(0.05, lambda: publisher.publish(interface_type("tf2_msgs/msg/TFMessage")(transforms=[stamped])))
rclpy.spin(node)
"""
    from waychair.ros.topics import TF

    heard = ros.heard(TF)
    with ros.process("-c", script):
        ros.spin_until(lambda: heard, "a transform")
    assert heard[0].transforms[0].child_frame_id == "moved"


def test_an_installed_package_is_preferred_to_a_built_one(ros: Harness, tmp_path: Path) -> None:
    package = tmp_path / "tf2_msgs" / "msg"
    package.mkdir(parents=True)
    (package.parent / "__init__.py").touch()
    (package / "__init__.py").write_text("class TFMessage: installed = True\n")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from waychair.ros.interface_types import interface_type; "
        "print(interface_type('tf2_msgs/msg/TFMessage').installed, "
        "'nav2_msgs' in interface_type('nav2_msgs/msg/SpeedLimit').__module__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "True"]


def test_two_processes_that_build_at_once_share_one_build(small: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from waychair.ros.interface_builder import built_interfaces; "
        f"folder = built_interfaces(Path({str(small)!r})); sys.path.append(str(folder)); import rclpy; "
        "from small_msgs.msg import Small; from rclpy.serialization import serialize_message, deserialize_message; "
        "back = deserialize_message(serialize_message(Small(count=7, values=[1.5])), Small); "
        "print(folder.stat().st_ino, back.count, back.values[0])"
    )
    both = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = [process.communicate(timeout=120.0)[0].split() for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert said[0] == said[1]
    assert said[0][1:] == ["7", "1.5"]
    cache = built_interfaces(small).parent
    assert sorted(path.suffix for path in cache.iterdir()) == ["", ".lock"], "the temporary build is removed"


def test_without_a_compiler_one_sentence_names_the_package_to_install(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CXX", raising=False)
    monkeypatch.setenv("PATH", str(small))
    with pytest.raises(InterfaceBuildError, match=r"no C\+\+ compiler was found.*`sudo apt install g\+\+`"):
        built_interfaces(small)
    assert [path.suffix for path in (small.parent / "cache" / "waychair").iterdir()] == [".lock"]


def test_an_invalid_definition_is_refused_with_the_message_of_the_generator(small: Path) -> None:
    (small / "small_msgs" / "msg" / "Small.msg").write_text("int32 Count\n")
    with pytest.raises(InterfaceBuildError, match=r"cannot be built.*Count"):
        built_interfaces(small)


def test_a_cache_without_write_permission_is_named(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (small.parent / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(small.parent / "file"))
    with pytest.raises(OutputError, match="XDG_CACHE_HOME"):
        built_interfaces(small)
