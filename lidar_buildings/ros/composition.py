"""Several nodes in one process: an executor and a thread for each."""

from __future__ import annotations

import threading

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from lidar_buildings.ros.stage_node import StageNode


class Composition:
    """
    Runs nodes of one context side by side; `stop` destroys them.

    One MultiThreadedExecutor for all would be several times slower than a SingleThreadedExecutor for each,
    and the nodes rely on their callbacks not running at once.
    """

    def __init__(self, *nodes: StageNode) -> None:
        self._nodes = nodes
        self._threads = [
            threading.Thread(target=_spin, args=(node,), name=node.get_name(), daemon=True) for node in nodes
        ]
        self._has_news = threading.Event()  # something has happened that may end a `wait`
        for node in nodes:
            node.outcome.add_done_callback(lambda _: self._has_news.set())
            node.context.on_shutdown(self._has_news.set)

    def start(self) -> None:
        """Let all nodes spin."""
        for node, thread in zip(self._nodes, self._threads, strict=True):
            node.publish_state()
            thread.start()

    def wait(self, node: StageNode, timeout: float | None = None) -> bool:
        """Wait for a node's outcome; False if there was none in time; raise what keeps any from going on."""
        self._has_news.wait(timeout)
        for one in self._nodes:
            if one.outcome.done():
                one.outcome.result()
        return node.outcome.done() or not rclpy.ok(context=node.context)

    def stop(self) -> None:
        """Shut ROS down, wait for the threads, and destroy the nodes."""
        for node in self._nodes:
            rclpy.try_shutdown(context=node.context)
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(60.0)  # wide margin: work is done beside callbacks
        for node in self._nodes:
            node.destroy_node()


def _spin(node: StageNode) -> None:
    """Spin a node; what it raises ends it, as its outcome."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        executor.spin()
    except ExternalShutdownException:
        pass
    except Exception as error:
        if rclpy.ok(context=node.context):  # else what a node still did met the end of ROS
            node.fail(error)
