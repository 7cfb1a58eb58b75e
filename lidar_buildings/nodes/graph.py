"""All nodes of a run in one process."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.nodes.table import SOURCES, nodes_until, topics_until
from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.ros.parameters import parameter_overrides
from lidar_buildings.ros.stage_node import StageNode

_CLASSES = {name: "".join(word.title() for word in name.split("_")) for name in NODE_CONFIGS}


def node_class(name: str) -> type[StageNode]:
    """Return the class of a node, `GroundFilter` for `ground_filter`."""
    module = import_module(f"lidar_buildings.nodes.{name}")
    found: type[StageNode] = getattr(module, _CLASSES[name])
    return found


def make_node(
    name: str, settings: Mapping[str, Mapping[str, Any]], pool: BuildingPool | None = None, **kwargs: Any
) -> StageNode:
    """
    Make a node.

    Parameters
    ----------
    name : str
        Its name.
    settings : mapping
        ``{stage: {name: value}}``; what is not named keeps its default, what is of other nodes is left out.
    pool : BuildingPool, optional
        Processes that do its work; it is done here if not given.
    **kwargs
        As for `rclpy.node.Node`: namespace, context…
    """
    # these work themselves; the others let processes work, to wait for no interpreter's lock in one process
    shared = {} if name in (*SOURCES, "recorder") else {"pool": pool}
    return node_class(name)(
        parameter_overrides=parameter_overrides(NODE_CONFIGS[name], settings), **shared, **kwargs
    )


def survey_nodes(
    inputs: Sequence[str],
    output: str,
    *,
    until: str = "building_model",
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    overwrite: bool = False,
    identity: Mapping[str, Any] | None = None,
    pool: BuildingPool | None = None,
    **kwargs: Any,
) -> dict[str, StageNode]:
    """
    Make the nodes of a run from files to files.

    Parameters
    ----------
    inputs : sequence of str
        Files, folders, globs.
    output : str
        Folder for the results.
    until : str
        The last stage.
    settings : mapping
        ``{stage: {name: value}}``; what is not named keeps its default.
    overwrite : bool
        Whether to begin anew in a folder with earlier results.
    identity : mapping
        All that results depend on, for taking an unfinished run up again; `settings` if not given.
    pool : BuildingPool, optional
        Processes that do the nodes' work.
    **kwargs
        As for `rclpy.node.Node`, the same for all: namespace, context…

    Returns
    -------
    dict
        Node name → node, the player first and the writer last; behind it the recorder, if it has an output.

    Raises
    ------
    LidarBuildingsError
        If a node cannot start; those made before are destroyed.
    """
    given = settings or {}
    merged = _merged(given, inputs, output, until, overwrite, given if identity is None else identity)
    nodes: dict[str, StageNode] = {}
    try:
        # the writer first: it refuses an output folder before anything is read, which begins with the player
        first, *between, last = names = nodes_until(until)
        recorder = ("recorder",) if merged.get("recorder", {}).get("output") else ()
        for name in (*recorder, last, first, *between):
            nodes[name] = make_node(name, merged, pool, **kwargs)
    except Exception:
        for node in nodes.values():
            node.destroy_node()
        raise
    return {name: nodes[name] for name in (*names, *recorder)}


def _merged(
    given: Mapping[str, Mapping[str, Any]],
    inputs: Sequence[str],
    output: str,
    until: str,
    overwrite: bool,
    identity: Mapping[str, Any],
) -> dict[str, dict[str, Any]]:
    """Return settings with what player and writer are given of the run."""
    own: dict[str, dict[str, Any]] = {
        "tile_player": {"input": tuple(inputs), "wait_for": topics_until(until)},
        "model_writer": {
            "input": tuple(inputs),
            "output": output,
            "until": until,
            "overwrite": overwrite,
            "settings": json.dumps(dict(identity), sort_keys=True),
        },
    }
    return {stage: {**given.get(stage, {}), **own.get(stage, {})} for stage in given.keys() | own.keys()}
