"""
Feed every node, in a process of its own, messages with extreme numbers on all its topics; then interrupt it.

    python -m bench.fuzz.nodes [--seconds S] [--only NODE ...] [--seed N]

Prints for each node how many messages were sent, whether it lived on, and how long it took to end on SIGINT,
which is 3 s at most; the exit status is 1 if a node died, took longer or printed a traceback.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.tables import table
from bench.fuzz.extremes import FIELDS_OF_TOPIC, cloud, numbers, random_text

#: The longest that a node may take to end [s], and that it may take to start.
LONGEST, _START = 3.0, 60.0
#: Messages of a topic a second.
_RATE = 20.0
_PROGRAM = "from lidar_buildings.commands.node import node_process; exit(node_process('{}'))"
_FLOATS = {"double": np.float64, "float": np.float32}


def main(arguments: list[str] | None = None) -> int:
    """Feed the nodes; return 1 if one did what it must not."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=5.0, help="how long each is fed (default: 5)")
    parser.add_argument("--only", nargs="+", metavar="NODE", help="some nodes alone")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    os.environ |= {"ROS_DOMAIN_ID": str(os.getpid() % 100 + 1), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    import rclpy

    from lidar_buildings.nodes.table import NODE_TABLE

    rclpy.init()
    rows, random = [], np.random.default_rng(options.seed)
    for card in NODE_TABLE:
        if not options.only or card.name in options.only:
            rows.append(_fed(card, options.seconds, random))
            print("  ".join(rows[-1]), flush=True)
    rclpy.try_shutdown()
    print(table(("node", "messages", "alive", "SIGINT [s]", "status", "tracebacks"), rows))
    return int(any(row[2] != "yes" or float(row[3]) > LONGEST or row[5] != "0" for row in rows))


def _fed(card: Any, seconds: float, random: np.random.Generator) -> list[str]:
    """Start a node, feed it and interrupt it; return its row."""
    from rclpy.node import Node

    with tempfile.TemporaryDirectory() as folder:
        given = _parameters(card.name, Path(folder))
        line = [sys.executable, "-c", _PROGRAM.format(card.name), "--ros-args", *given]
        with open(Path(folder) / "errors", "w+b") as errors:
            process = subprocess.Popen(line, stdout=errors, stderr=errors)
            sender = Node("rubbish")
            try:
                n_sent = _send(sender, card, process, seconds, random)
                is_alive = process.poll() is None
                process.send_signal(signal.SIGINT)
                began = time.monotonic()
                with suppress(subprocess.TimeoutExpired):
                    process.wait(10.0 * LONGEST)
                took = time.monotonic() - began
                process.kill()
            finally:
                sender.destroy_node()
            errors.seek(0)
            n_tracebacks = errors.read().count(b"Traceback")
        told = (n_sent, "yes" if is_alive else "no", f"{took:.2f}", process.returncode, n_tracebacks)
        return [card.name, *map(str, told)]


def _parameters(name: str, folder: Path) -> list[str]:
    if name == "model_writer":
        return ["-p", f"output:={folder / 'out'}"]
    if name == "scan_assembler":
        return ["-p", f"spool:={folder / 'spool'}"]
    if name == "recorder":
        return ["-p", f"output:={folder / 'bag'}"]
    if name == "tile_player":
        from bench.fuzz.files import plain_cloud

        return ["-p", f"input:=['{plain_cloud(folder)}']"]
    return []


def _send(
    sender: Any, card: Any, process: subprocess.Popen[bytes], seconds: float, random: np.random.Generator
) -> int:
    """Publish on all topics of a node for a while from when it listens; return how many messages."""
    qos = import_module("lidar_buildings.ros.qos")
    publishers = []
    for topic in card.subscribes:
        package, _, name = topic.type.partition("/")
        with suppress(ImportError):
            kind = getattr(import_module(f"{package}.msg"), name)
            publishers.append(
                (topic.name, kind, sender.create_publisher(kind, topic.name, getattr(qos, topic.qos)))
            )
    end = time.monotonic() + _START
    while time.monotonic() < end and process.poll() is None:
        if all(one.get_subscription_count() for _, _, one in publishers):
            break
        time.sleep(0.05)
    n_sent, end = 0, time.monotonic() + seconds
    while time.monotonic() < end and process.poll() is None:
        for name, kind, publisher in publishers:
            publisher.publish(_message(name, kind, random))
            n_sent += 1
        time.sleep(1.0 / _RATE)
    return n_sent


def _message(topic: str, kind: Any, random: np.random.Generator) -> Any:
    if kind.__name__ == "PointCloud2":
        from bench.fuzz.targets import as_ros

        return as_ros(cloud(random, topic if topic in FIELDS_OF_TOPIC else "points"))
    if kind.__name__ == "String":
        return kind(data=random_text(random)[1])
    return _filled(kind, random)


def _filled(kind: Any, random: np.random.Generator) -> Any:
    """Return a message of any type with extreme numbers."""
    message = kind()
    for name, what in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if what in _FLOATS:
            with np.errstate(over="ignore"):
                number = _FLOATS[what](numbers(random, 1)[0])
            setattr(message, name, float(number) if np.isfinite(number) else 3e38)
        elif what.startswith("sequence<") and "/" in what:
            package, _, own = what.removeprefix("sequence<").split(",")[0].rstrip(">").partition("/")
            inner = getattr(import_module(f"{package}.msg"), own)
            setattr(message, name, [_filled(inner, random) for _ in range(random.integers(0, 5))])
        elif "/" in what:
            setattr(message, name, _filled(type(value), random))
        elif what.startswith(("int", "uint")) and "[" not in what:
            bits = int(what.removeprefix("u").removeprefix("int"))
            top = min(2 ** (bits - what.startswith("int")) - 1, 2**31 - 1)
            setattr(message, name, int(random.choice([0, 1, 77, top])))
    return message


if __name__ == "__main__":
    raise SystemExit(main())
