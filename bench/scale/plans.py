"""
What was planned for a run, and what it took.

    python -m bench.scale.plans INPUT... [--options "--no-ros --tile-size 60"]

Each INPUT is a survey of its own: a file, a folder or a glob.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import tempfile
from pathlib import Path

from bench.chain.child import run_child


def main() -> None:
    """Print a line for each survey: planned, taken, and how far the plan was off."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("input", nargs="+")
    parser.add_argument("--options", default="--no-ros")
    options = parser.parse_args()
    for survey in options.input:
        with tempfile.TemporaryDirectory(prefix="plans_") as folder:
            output = Path(folder, "out")
            command = [sys.executable, "-m", "lidar_buildings.cli", "run", survey, "--output", str(output)]
            usage = run_child([*command, *shlex.split(options.options)], output=output)
            told = json.loads((output / "run.json").read_text())
            results = sum(file.stat().st_size for file in output.rglob("*") if file.is_file())
        plan = {name: (one["planned"], one["taken"]) for name, one in told["plan"].items()}
        figures = ", ".join(f"{name} {a:.4g} / {b:.4g} ({a / b - 1:+.0%})" for name, (a, b) in plan.items())
        whole = f"{usage.wall:.1f} s, {usage.cpu:.1f} processor s (others {usage.others:.0f})"
        disk = f"temporary {usage.disk / 1e6:.0f} MB, results {results / 1e6:.0f} MB"
        print(
            f"{survey} {options.options}: {told['n_points']:,} points, {told['n_tiles']} tiles: {figures}; "
            f"the whole command {whole}, {usage.memory / 1e6:.0f} MB, {disk}",
            flush=True,
        )


if __name__ == "__main__":
    main()
