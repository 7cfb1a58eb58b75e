"""
What is planned for a run, and what it takes.

    python -m bench.scale.plans INPUT... [--options "--no-ros --tile-size 60"]

Each INPUT is a survey of its own: a file, a folder or a glob.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
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
            command = [sys.executable, "-m", "lidar_buildings.cli"]
            more = shlex.split(options.options)
            planned = subprocess.run(
                [*command, "plan", survey, "--json", *more], capture_output=True, check=True
            )
            plan = json.loads(planned.stdout)
            usage = run_child([*command, "run", survey, "--output", str(output), *more], output=output)
            results = sum(file.stat().st_size for file in output.rglob("*") if file.is_file())
        taken = {"wall": usage.wall, "processor": usage.cpu, "memory": usage.memory}
        figures = ", ".join(
            f"{name} {plan[name]:.4g} / {b:.4g} ({plan[name] / b - 1:+.0%})" for name, b in taken.items()
        )
        disk = f"temporary {usage.disk / 1e6:.0f} MB, results {results / 1e6:.0f} MB"
        print(
            f"{survey} {options.options}: {plan['points']:,} points, {plan['tiles']} tiles: {figures} "
            f"(others {usage.others:.0f} s); {disk}",
            flush=True,
        )


if __name__ == "__main__":
    main()
