"""
Writes what is generated from the configs and the table of nodes: the parameter file and the node pages.

``python -m bench.pages.node_reference`` writes ``config/pipeline.param.yaml``, ``doc/nodes.md`` and a
page for each node in ``doc/nodes``; with ``--check`` it only says whether they are as they should be.
"""

from __future__ import annotations

import argparse
import re
import sys
import textwrap
from dataclasses import Field
from pathlib import Path
from typing import Any

import yaml

from bench.pages.node_texts import MEANINGS, SERVICES, SUMMARIES
from lidar_buildings.core.model.parameters import StageConfig, parameter_names, prefix_of, spec_of
from lidar_buildings.nodes.configs import NODE_CONFIGS
from lidar_buildings.nodes.table import NODE_TABLE, OF_EVERY_NODE, NodeCard, Topic
from lidar_buildings.ros.depths import CLOUD_DEPTH, EVENT_DEPTH, HISTORY_DEPTH, MAP_DEPTH, RING_DEPTH

_COMMAND = "python -m bench.pages.node_reference"
_PARAMETER_FILE = "pipeline.param.yaml"
_WIDTH = 110


def parameter_yaml() -> str:
    """Return ``config/pipeline.param.yaml``: the parameters that users turn, with default, unit and range."""
    lines = [
        f"# The parameters that users turn, with their defaults. Written by `{_COMMAND}`.",
        "# All others are in doc/nodes, under `advanced`. `/**/` stands for any namespace.",
        "# Copy the lines that you change into a file of your own.",
    ]
    owners: dict[str, str] = {}
    for node, configs in NODE_CONFIGS.items():
        for stage, config in configs.items():
            is_inner = bool(prefix_of(stage, configs))
            indent = "      " if is_inner else "    "
            shown = [one for _, one in parameter_names({stage: config}).values() if not spec_of(one).advanced]
            if not shown or config.is_of_node or owners.setdefault(stage, node) != node:
                continue
            if f"/**/{node}:" not in lines:
                lines += ["", f"/**/{node}:", "  ros__parameters:"]
            if is_inner:
                lines.append(f"    {stage}:")
            for one in shown:
                lines += [
                    *_comment(_sentence(one), indent),
                    f"{indent}{one.name}: {_yaml_value(one.default)}",
                ]
    return "\n".join(lines) + "\n"


def nodes_page() -> str:
    """Return ``doc/nodes.md``."""
    parts = [
        "# Nodes",
        f"<!-- Written by `{_COMMAND}`; change the configs, `nodes/table.py` or `node_texts.py` instead. -->",
        "All names are relative: put a graph under a namespace and remap as you like. Parameters marked "
        "*fixed* are set when the node starts, the others can be changed while it runs and count from the "
        "next tile on. `config/pipeline.param.yaml` has the few that users turn; the others are called "
        "`advanced.NAME`, after the stage where a node has several; parameter files and `--set` may leave "
        "`advanced.` out.",
        "Fast DDS keeps at most 5000 messages of a topic, and a tile can have more rings. The nodes lift "
        "that limit by a profile of their own (`ros/fastdds_profile.xml`, [hosts.md](hosts.md)), unless "
        "`FASTRTPS_DEFAULT_PROFILES_FILE` names yours: set `max_samples`, `max_instances` and "
        "`max_samples_per_instance` to 0 in it.",
        "\n".join(
            [
                "| node | |",
                "|---|---|",
                *(f"| [{one.name}](nodes/{one.name}.md) | {_first_sentence(one)} |" for one in NODE_TABLE),
            ]
        ),
        "## Quality of service",
        _profiles(),
        "\n".join(["```{toctree}", ":hidden:", *(f"nodes/{card.name}" for card in NODE_TABLE), "```"]),
    ]
    return "\n\n".join(parts) + "\n"


def _first_sentence(card: NodeCard) -> str:
    return f"{' '.join(SUMMARIES[card.name].split()).split('. ')[0].rstrip('.')}."


def node_page(card: NodeCard) -> str:
    """Return ``doc/nodes/NAME.md``."""
    return re.sub(r"\]\((?=[\w/]+\.md)", "](../", _node_section(card)) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Write the files, or check them."""
    parser = argparse.ArgumentParser(prog=_COMMAND, description="Write parameter file and node pages.")
    parser.add_argument("--check", action="store_true", help="only say which files are out of date")
    check = parser.parse_args(arguments).check
    stale = [path for path, content in _files().items() if not _holds(path, content)]
    for path in stale:
        name = path.relative_to(_root())
        if check:
            sys.stderr.write(f"{name} is out of date: run `{_COMMAND}`\n")
            continue
        path.parent.mkdir(exist_ok=True)
        path.write_text(_files()[path], encoding="utf-8")
        sys.stdout.write(f"{name} written\n")
    return 1 if check and stale else 0


def _root() -> Path:
    return Path(__file__).resolve().parents[2]


def _files() -> dict[Path, str]:
    """Return path → content of all that is generated."""
    return {
        _root() / "config" / _PARAMETER_FILE: parameter_yaml(),
        _root() / "doc" / "nodes.md": nodes_page(),
        **{_root() / "doc" / "nodes" / f"{card.name}.md": node_page(card) for card in NODE_TABLE},
    }


def _holds(path: Path, content: str) -> bool:
    return path.is_file() and path.read_text(encoding="utf-8") == content


def _comment(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _sentence(one: Field[Any]) -> str:
    """Return description, unit and range of a parameter."""
    spec = spec_of(one)
    unit = f" [{spec.unit}]" if spec.unit else ""
    allowed = _allowed(one)
    return f"{spec.description.rstrip('.')}{unit}.{f' {allowed}.' if allowed else ''}"


def _allowed(one: Field[Any]) -> str:
    """Return a parameter's range in words, empty where anything will do."""
    spec = spec_of(one)
    text = "" if spec.is_free else spec.allowed().split(" [")[0]
    return text[:1].upper() + text[1:]


def _yaml_value(value: Any) -> str:
    """Return a default as ROS's YAML has it: floats with a point, lists of texts never empty."""
    if isinstance(value, tuple):
        value = list(value) or [""]
    if isinstance(value, float):
        text = repr(value)
        return text if "." in text or "e" not in text else text.replace("e", ".0e")
    return yaml.safe_dump(value, default_flow_style=True, width=10_000).split("\n")[0]


def _profiles() -> str:
    """Say what the quality-of-service names mean."""
    return "\n".join(
        [
            "| QoS | reliability | history | durability |",
            "|---|---|---|---|",
            f"| CLOUD | reliable | keep last {CLOUD_DEPTH} | volatile |",
            "| BUILDING | reliable | keep all | volatile |",
            f"| EVENT | reliable | keep last {EVENT_DEPTH} | volatile |",
            "| LATCHED | reliable | keep last 1 | transient local |",
            f"| MAP | reliable | keep last {MAP_DEPTH} | transient local |",
            f"| MAP_RINGS | reliable | keep last {RING_DEPTH} | transient local |",
            f"| LATCHED_HISTORY | reliable | keep last {HISTORY_DEPTH} | transient local |",
        ]
    )


def _node_section(card: NodeCard) -> str:
    parts = [
        f"# {card.name}",
        f"<!-- Written by `{_COMMAND}`. -->",
        SUMMARIES[card.name],
        _topic_table("Subscribed", [(one, subscribed_qos(card, one)) for one in card.subscribes]),
        _topic_table("Published", [(one, one.qos) for one in (*card.publishes, *OF_EVERY_NODE)]),
    ]
    if services := services_of(card.name):
        rows = [f"| **{one}** | std_srvs/Trigger | {meaning} |" for one, meaning in services.items()]
        parts.append("\n".join(["## Services", "", "| name | type | meaning |", "|---|---|---|", *rows]))
    parts += _parameter_tables(NODE_CONFIGS[card.name])
    return "\n\n".join(parts)


def services_of(node: str) -> dict[str, str]:
    """Return the services of a node beside those of every ROS node → what they do."""
    return {key.split()[1]: meaning for key, meaning in SERVICES.items() if key.split()[0] == node}


def subscribed_qos(card: NodeCard, topic: Topic) -> str:
    """Return the profile with which a node subscribes; the recorder takes earlier messages, too."""
    return topic.qos if card.name == "recorder" else topic.listener_qos


def _topic_table(title: str, topics: list[tuple[Topic, str]]) -> str:
    rows = [f"| **{topic.name}** | {topic.type} | {qos} | {_meaning(topic)} |" for topic, qos in topics]
    head = [f"## {title}", "", "| topic | type | QoS | meaning |", "|---|---|---|---|"]
    return "\n".join([*head, *rows])


def _meaning(topic: Topic) -> str:
    is_header = (topic.name, topic.qos) == ("city_model", "LATCHED")
    return MEANINGS[f"{topic.name} header" if is_header else topic.name]


def _parameter_tables(configs: dict[str, type[StageConfig]]) -> list[str]:
    """Return the table of what users turn and that of all else."""
    rows: dict[bool, list[str]] = {False: [], True: []}
    for name, (_, one) in parameter_names(configs).items():
        kind = {"tuple": "string[]", "str": "string", "float": "double"}.get(
            type(one.default).__name__, type(one.default).__name__
        )
        meaning = f"{_sentence(one)}{' *fixed*' if spec_of(one).read_only else ''}"
        rows[spec_of(one).advanced].append(
            f"| **{name}** | {kind} | `{_yaml_value(one.default)}` | {meaning} |"
        )
    head = ["", "| name | type | default | meaning |", "|---|---|---|---|"]
    titles = {False: "## Parameters", True: "## Advanced parameters"}
    return ["\n".join([titles[advanced], *head, *found]) for advanced, found in rows.items() if found]


if __name__ == "__main__":
    raise SystemExit(main())
