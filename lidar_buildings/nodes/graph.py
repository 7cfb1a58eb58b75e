"""All nodes of a run in one process, and what source and writer are told of it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from lidar_buildings.io.bags.bag_inputs import bags_among
from lidar_buildings.io.results.run_folder import PARTIAL, PLACED
from lidar_buildings.io.tiling.live_files import CLOUDS
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.nodes.table import NODE_STAGES, SOURCES, nodes_until, topics_until
from lidar_buildings.ros.depths import MOST_TILES
from lidar_buildings.ros.parameters import parameter_overrides
from lidar_buildings.ros.stage_node import StageNode


def node_class(name: str) -> type[StageNode]:
    """Return the class of a node, `GroundFilter` for `ground_filter`."""
    module = "stage_nodes" if name in NODE_STAGES else name
    kind = name.title().replace("_", "")
    found: type[StageNode] = getattr(import_module(f"lidar_buildings.nodes.{module}"), kind)
    return found


def make_node(
    name: str, settings: Mapping[str, Mapping[str, Any]], pool: Any = None, **kwargs: Any
) -> StageNode:
    """
    Make a node; of the settings what is not named keeps its default, what is of other nodes is left out.
    """
    overrides = parameter_overrides(NODE_CONFIGS[name], settings)
    return node_class(name)(parameter_overrides=overrides, pool=pool, **kwargs)


def survey_nodes(
    inputs: Sequence[str],
    output: str,
    *,
    source: str = SOURCES[0],
    until: str = "building_model",
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    overwrite: bool = False,
    identity: Mapping[str, Any] | None = None,
    pool: Any = None,
    **kwargs: Any,
) -> dict[str, StageNode]:
    """
    Make the nodes of a run from files, or a feed, to files; without `output` topics only.

    What `settings`, ``{stage: {name: value}}``, do not name keeps its default. `identity` is all that results
    depend on, for taking an unfinished run up again; the settings if not given. Each node gets the other
    arguments as `rclpy.node.Node`. The source comes first and the writer last; behind it the recorder, if it
    has an output. LidarBuildingsError if a node cannot start; those made before are destroyed.
    """
    given = settings or {}
    recorder = ("recorder",) if given.get("recorder", {}).get("output") else ()
    own = run_settings(source, inputs, output, until, is_recorded=bool(recorder))
    kept = json.dumps(dict(given if identity is None else identity), sort_keys=True)
    own["model_writer"] |= {"overwrite": overwrite, "settings": kept}
    own["flow_control"] = {"publish_tile_done": not output}
    if pool is not None and not pool.n_workers:  # one core: each node works in its own thread
        pool = None
    if pool is not None and "max_tiles_in_flight" not in given.get(source, {}):
        own[source]["max_tiles_in_flight"] = min(max(2, pool.n_workers), MOST_TILES)
    merged = {stage: {**given.get(stage, {}), **own.get(stage, {})} for stage in given.keys() | own.keys()}
    nodes: dict[str, StageNode] = {}
    try:
        # the recorder first, which misses nothing; then the player, which reads while the others are made
        names = [name for name in nodes_until(until, source) if output or name != "model_writer"]
        for name in (*recorder, *names):
            points: dict[str, dict[str, Any]] = {  # decoded once
                "tile_player": {"keep": bool(output)},
                "model_writer": {"read": getattr(nodes.get("tile_player"), "inputs", ())},
            }
            nodes[name] = make_node(name, merged, pool, **points.get(name, {}), **kwargs)
    except Exception:
        for node in nodes.values():
            node.destroy_node()
        raise
    return {name: nodes[name] for name in (*names, *recorder)}


def feed_folder(output: str | Path) -> Path:
    """Return the folder, within that of the results, in which the points of a feed, or of bags, wait."""
    return Path(output) / PARTIAL / PLACED


def run_settings(
    source: str,
    inputs: Sequence[str],
    output: str,
    until: str = "building_model",
    *,
    is_recorded: bool = False,
) -> dict[str, dict[str, Any]]:
    """
    Return what source and writer are told of a run, ``{stage: {name: value}}``.

    Where the recorder listens to `points`, too, it is named twice, so that both are waited for.
    """
    waits = {"wait_for": topics_until(until, has_writer=bool(output)) + ("points",) * is_recorded}
    writer = {"output": output, "until": until}
    folder = feed_folder(output)
    if source == SOURCES[0]:
        given: dict[str, Any] = {"input": tuple(inputs)}
        if output and bags_among(inputs):
            given["placed"] = str(folder)
        return {source: given | waits, "model_writer": given | writer}
    spool = {"spool": str(folder)} if output else {}
    return {source: {**spool, **waits}, "model_writer": {"placed": str(folder / CLOUDS), **writer}}
