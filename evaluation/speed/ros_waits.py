"""Processor time of one wait and one callback of a node's executor, beside rclpy's, on a node of the bridge's size.

    python -m evaluation.speed.ros_waits

Both executors serve the same node in turns: a timer of 200 Hz, as many subscriptions and services as the bridge has, and
nothing else to do. Where ROS is not installed it says so.
"""

from __future__ import annotations

import importlib.util
import json
import statistics
import time
from typing import Any

TURNS, CALLBACKS, PERIOD_S = 7, 400, 0.005
SUBSCRIPTIONS, PUBLISHERS, SERVICES = 20, 15, 10


def main() -> None:
    """Print the median processor time [µs] of a wait with either executor, and the median ratio of the turns."""
    if importlib.util.find_spec("rclpy") is None:
        print("ROS is not installed (no rclpy): the waits of nodes are not measured")
        return
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from waychair.ros.environment import enter_ros_environment
    from waychair.ros.executor import NodeExecutor

    enter_ros_environment(domain=101)
    rclpy.init(args=[])
    node, ticks = _node()
    rows = [
        (_wait_us(node, ticks, NodeExecutor()), _wait_us(node, ticks, SingleThreadedExecutor())) for _ in range(TURNS)
    ]
    ours, theirs = zip(*rows, strict=True)
    node.destroy_node()
    rclpy.shutdown()
    print(
        json.dumps(
            {
                "node_executor_us": round(statistics.median(ours)),
                "rclpy_us": round(statistics.median(theirs)),
                "ratio": round(statistics.median(a / b for a, b in rows), 2),
            }
        )
    )


def _node() -> tuple[Any, list[float]]:
    """Return a node of the bridge's size, and the times of its timer's calls."""
    import rclpy
    from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

    from waychair.ros.interface_types import interface_type

    text, trigger = interface_type("std_msgs/msg/String"), interface_type("std_srvs/srv/Trigger")
    node = rclpy.create_node("waits", start_parameter_services=False)
    for number in range(SUBSCRIPTIONS):
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        node.create_subscription(text, f"heard_{number}", print, 10, raw=True, event_callbacks=quiet)
    for number in range(PUBLISHERS):
        node.create_publisher(
            text, f"told_{number}", 10, event_callbacks=PublisherEventCallbacks(use_default_callbacks=False)
        )
    for number in range(SERVICES):
        node.create_service(trigger, f"asked_{number}", lambda request, response: response)
    ticks: list[float] = []
    node.create_timer(PERIOD_S, lambda: ticks.append(time.monotonic()))
    return node, ticks


def _wait_us(node: Any, ticks: list[float], executor: Any) -> float:
    """Return the processor time [µs] per callback of the timer while an executor serves the node."""
    executor.add_node(node)
    for _ in range(10):
        executor.spin_once()
    ticks.clear()
    begun = time.process_time()
    while len(ticks) < CALLBACKS:
        executor.spin_once()
    used_s = time.process_time() - begun
    executor.remove_node(node)
    executor.shutdown()
    return used_s / CALLBACKS * 1e6


if __name__ == "__main__":
    main()
