"""Two hosts on one machine: network namespaces with a cable between them, and shared memory of their own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from support.node_processes import NodeProcesses

#: Address of each host; documentation addresses (RFC 5737), which no network has.
HOSTS = {"left": "192.0.2.1", "right": "192.0.2.2"}
#: Nodes of the first host; all others are on the second.
LIGHT = ("tile_player", "model_writer")
#: Holds a host's memory as long as it runs; says so when it does.
_KEEPER = "mount -t tmpfs none /dev/shm && echo ready && exec sleep infinity"


@contextmanager
def two_hosts() -> Iterator[dict[str, int]]:
    """Return host → process whose namespaces it has; OSError or CalledProcessError where forbidden."""
    networks = {host: f"lb{os.getpid()}{host[0]}" for host in HOSTS}
    keepers: dict[str, subprocess.Popen] = {}
    try:
        for network in networks.values():
            _ip("netns", "add", network)
        _ip("link", "add", networks["left"], "type", "veth", "peer", "name", networks["right"])
        for host, network in networks.items():
            _ip("link", "set", network, "netns", network)
            _ip("-n", network, "addr", "add", f"{HOSTS[host]}/24", "dev", network)
            for link in (network, "lo"):
                _ip("-n", network, "link", "set", link, "up")
            command = ["ip", "netns", "exec", network, "unshare", "--mount", "sh", "-c", _KEEPER]
            keepers[host] = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
            if keepers[host].stdout.readline() != "ready\n":
                raise OSError("no memory of its own can be mounted for a host")
        yield {host: keeper.pid for host, keeper in keepers.items()}
    finally:
        for keeper in keepers.values():
            keeper.kill()
            keeper.communicate()
        for network in networks.values():
            subprocess.run(["ip", "netns", "del", network], check=False, capture_output=True)


def inside(keeper: int, *command: str) -> list[str]:
    """Return a command that runs on a host."""
    return ["nsenter", "--target", str(keeper), "--mount", "--net", *command]


#: Forks nodes: importing takes longer than most of them work.
_FORK = "from support.node_processes import fork_nodes; fork_nodes()"


class _Forking(subprocess.Popen):
    """A process of a host that forks nodes, all of which are killed with it."""

    def __init__(self, keeper: int) -> None:
        paths = {"PYTHONPATH": os.pathsep.join(map(str, (Path(__file__).parents[1], *sys.path)))}
        given = {"stdin": subprocess.PIPE, "text": True, "start_new_session": True}
        super().__init__(inside(keeper, sys.executable, "-c", _FORK), env=os.environ | paths, **given)

    def kill(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)


class OnTwoHosts(NodeProcesses):
    """The heavy nodes on one host, the source and the writer on the other."""

    def __init__(self, hosts: dict[str, int], *arguments, **keywords) -> None:
        super().__init__(*arguments, **keywords)
        self._left, self._right = hosts["left"], _Forking(hosts["right"])

    def started(self, name, module, arguments, slow, log):
        if name not in LIGHT:
            print(json.dumps([module, arguments, slow, str(log)]), file=self._right.stdin, flush=True)
            return self._right
        program = f"from lidar_buildings.commands.node import node_process; exit(node_process('{module}'))"
        command = [sys.executable, "-c", program, *arguments]
        with log.open("a") as written:
            return subprocess.Popen(inside(self._left, *command), stdout=written, stderr=written)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)
