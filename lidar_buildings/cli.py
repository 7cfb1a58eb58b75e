"""The `lidar-buildings` command."""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import re
import signal
import sys
import traceback
from contextlib import suppress
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from lidar_buildings import __version__
from lidar_buildings.commands.run_options import (
    UNTOLD,
    Once,
    add_part_of_bag,
    add_plan_arguments,
    add_record,
    add_run_arguments,
    add_settings,
)
from lidar_buildings.commands.terminal import coloured
from lidar_buildings.commands.view import add_view_arguments
from lidar_buildings.core.model.errors import ExitStatus
from lidar_buildings.evaluation.command.score import add_score_arguments

#: What ends a command as Ctrl-C does: of schedulers and containers, and of a terminal that is closed.
_ENDING = (signal.SIGTERM, signal.SIGHUP)


_EPILOG = """examples:
  lidar-buildings simulate --output tiles            # a virtual survey to try with
  lidar-buildings run tiles --output result          # then open result/report.html
  lidar-buildings explain result X,Y                 # why a building looks as it does, or is missing

exit status: 0 success; 1 defect; 2 wrong use or unreadable input; 3 a tile failed and the rest was done;
4 all was done, but there is something to look at first (run --strict); 130 interrupted"""
#: Shells, and what their users do with the script.
SHELLS = {
    "bash": "lidar-buildings completion bash > ~/.local/share/bash-completion/completions/lidar-buildings",
    "zsh": "lidar-buildings completion zsh > ~/.zfunc/_lidar-buildings      # a folder of $fpath",
    "fish": "lidar-buildings completion fish > ~/.config/fish/completions/lidar-buildings.fish",
}
#: Command → how it is used.
_EXAMPLES = {
    "run": """  lidar-buildings run tiles/ --output result
  lidar-buildings run drive.mcap tiles/ --output result --align
  lidar-buildings run tiles/ --output result --footprints houses.gpkg --no-ros
  lidar-buildings run tiles/ --output result --set roof_selection.min_height=2.5 --until regularisation""",
    "plan": "  lidar-buildings plan tiles/ --workers 8",
    "adjust": "  lidar-buildings adjust strips/ --output adjusted",
    "live": """  lidar-buildings live --output result --scan /velodyne_points
  lidar-buildings live --output result --replay drive --rate 0""",
    "simulate": """  lidar-buildings simulate --output tiles --scene roof_types --density 8
  lidar-buildings simulate --bag flight --scene village""",
    "score": "  lidar-buildings score buildings,models result tiles --merge-touching",
    "compare": "  lidar-buildings compare result_2020 result_2024",
    "view": "  lidar-buildings view result --picture result.png",
    "explain": "  lidar-buildings explain result 85012.5,447310",
    "completion": "\n".join(f"  {use}" for use in SHELLS.values()),
}


#: What argparse says of a word that is none of those it knows.
_WRONG_CHOICE = re.compile(r"invalid choice: '(?P<word>[^']*)' \(choose from (?P<choices>.*)\)")


class OneLineParser(argparse.ArgumentParser):
    """Reports wrong use in one line, as every other error."""

    def error(self, message: str) -> NoReturn:
        """Print one line and exit."""
        if wrong := _WRONG_CHOICE.search(message):
            choices = wrong["choices"].replace("'", "").split(", ")
            if near := get_close_matches(wrong["word"], choices, 1):
                message = f"{message[: wrong.start()]}no {wrong['word']!r}: did you mean {near[0]}?"
        self.exit(ExitStatus.WRONG_USE, f"{self.prog}: {message} (see --help)\n")


def console() -> NoReturn:
    """Run one command as a process, and end it: without the 0.1 s that Fast DDS sleeps when unloaded."""
    status = 1  # of an exception

    @atexit.register  # the first, so that it is called last
    def leave() -> None:
        if "rclpy" in sys.modules:
            with suppress(OSError):
                sys.stdout.flush()
            os._exit(status)

    for number in _ENDING:
        if signal.getsignal(number) is signal.SIG_DFL:  # nohup has them ignored
            signal.signal(number, signal.default_int_handler)
    try:
        status = main()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else ExitStatus.WRONG_USE
        raise
    sys.exit(status)


def main(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit status."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a name, or ×, that the terminal's encoding lacks ends no command
            stream.reconfigure(errors="backslashreplace")
    parser = command_parser()
    words = sys.argv[1:] if arguments is None else arguments
    if not words:
        parser.print_help()
        return ExitStatus.DONE
    options = parser.parse_args(words)
    # Matrices are small, and threads that wait for the next one keep cores from tiles.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Imported late: --help answers at once, and malloc can be tuned before ROS allocates.
    from lidar_buildings.commands.versions import check_versions
    from lidar_buildings.core.model.errors import LidarBuildingsError, printable

    try:
        check_versions()
        status = options.command(options)
        if sys.stdout is not None:
            sys.stdout.flush()  # here, where a closed pipe is caught
        return status
    except LidarBuildingsError as error:
        if options.debug:
            traceback.print_exc()
        for line in str(error).splitlines():
            print(f"{coloured('lidar-buildings:', 'red', sys.stderr)} {line}", file=sys.stderr)
        return ExitStatus.WRONG_USE
    except ImportError as error:  # for instance numba's, of a numpy that it does not know
        if options.debug:
            traceback.print_exc()
        print(f"lidar-buildings: import failed: {error} (--debug shows the traceback)", file=sys.stderr)
        return ExitStatus.WRONG_USE
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitStatus.DONE
    except OSError as error:  # what nobody expected of a file, a folder or a connection is no defect
        if options.debug:
            traceback.print_exc()
        where = f"{str(error.filename)[:200]}: " if error.filename else ""
        why = printable(f"{where}{error.strerror or error}")
        print(f"lidar-buildings: {why}: check the path, its permissions and the disk", file=sys.stderr)
        return ExitStatus.WRONG_USE
    except KeyboardInterrupt:
        print("lidar-buildings: interrupted; run the same command to resume", file=sys.stderr)
        return ExitStatus.INTERRUPTED
    except Exception as error:
        if options.debug:
            traceback.print_exc()
        what = printable(f"{type(error).__name__}: {' '.join(str(error).split())}")
        print(
            f"lidar-buildings: stopped by a defect ({what}): please report it with --debug", file=sys.stderr
        )
        return ExitStatus.DEFECT


def command_parser(store: type[argparse.Action] | None = None) -> argparse.ArgumentParser:
    """Return the parser of all commands, with an action in place of the one that stores values."""
    raw = argparse.RawDescriptionHelpFormatter  # examples stand line by line
    parser = OneLineParser(
        prog="lidar-buildings",
        description="Raw lidar in, valid 3D city models out.",
        epilog=_EPILOG,
        formatter_class=raw,
    )
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, add_arguments, command, words in (
        ("run", add_run_arguments, _run, "turn point clouds into classified points, outlines and models"),
        ("plan", add_plan_arguments, "commands.plan", "estimate what a run will take, from headers alone"),
        ("inspect", _add_inspect, "commands.inspect", "describe files and bags"),
        ("adjust", _add_adjust, "commands.adjust", "lay overlapping flight strips on each other"),
        ("live", _add_live, "commands.live", "process the feed of a scanner until interrupted"),
        ("simulate", _add_simulate, _simulate, "simulate a survey with ground truth"),
        ("score", add_score_arguments, "evaluation.command.score", "compare a result with a reference"),
        ("compare", _add_compare, "evaluation.changes", "report what changed between two results"),
        ("report", _add_folder, "commands.view", "rebuild the report of a result"),
        ("serve", _add_serve, "commands.view", "show a result of any size in a browser of this machine"),
        (
            "view",
            add_view_arguments,
            "commands.view",
            "show a result in a window, or save a picture (extra [view])",
        ),
        ("explain", _add_explain, "commands.view", "explain the outline and roof of a building"),
        ("top", _add_top, "commands.top", "monitor running graphs"),
        ("node", _add_node, "commands.node", "run one node of the graph in this process"),
        ("warm-up", _add_warm_up, "commands.warm_up", "compile now what the first run would compile"),
        ("completion", _add_completion, _completion, "print a script that completes commands in a shell"),
    ):
        epilog = f"examples:\n{_EXAMPLES[name]}" if name in _EXAMPLES else None
        one = commands.add_parser(
            name, help=words, description=f"{_capital(words)}.", epilog=epilog, formatter_class=raw
        )
        if store is not None:
            one.register("action", None, store)
        add_arguments(one)
        one.add_argument("--debug", action="store_true", help="show tracebacks")
        one.set_defaults(command=partial(_call, name, command) if isinstance(command, str) else command)
    return parser


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _add_completion(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=tuple(SHELLS), metavar="SHELL", help="bash, zsh or fish")


def _completion(options: argparse.Namespace) -> int:
    from lidar_buildings.commands.completion import completion_script

    print(completion_script(command_parser, options.shell))
    return ExitStatus.DONE


def _call(name: str, module: str, options: argparse.Namespace) -> int:
    """Call a command of a module that is not imported before: --help answers at once."""
    command = getattr(import_module(f"lidar_buildings.{module}"), f"{name.replace('-', '_')}_command")
    return command(options)


def _run(options: argparse.Namespace) -> int:
    gc.disable()  # imports leave no garbage, and looking for it takes a fifth of their time
    from lidar_buildings.commands.run import run_command

    options.no_ros |= bool(options.workers or options.scheduler or options.update or options.retry_failed)
    options.output = options.update or options.output
    gc.freeze()
    gc.enable()
    atexit.register(gc.freeze)  # the interpreter's end looks for garbage once more
    gc.set_threshold(50_000)  # arrays and shapes leave little garbage: looking for it took 2 % of a run
    return run_command(options)


def _add_live(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--output", required=True, type=Path, metavar="DIR", help="folder for the results")
    add(
        "--scan",
        dest="topic",
        metavar="TOPIC",
        action=Once,
        help="topic of the scans (default: scan; for a bag its only one)",
    )
    add(
        "--odometry",
        metavar="TOPIC",
        action=Once,
        help="topic of the poses (default: odometry; for a bag its only one); /tf is read, too",
    )
    add("--fix", metavar="TOPIC", action=Once, help="topic of GNSS positions (default: fix)")
    add("--replay", type=Path, metavar="BAG", help="play a bag instead of listening, and stop at its end")
    add(
        "--rate",
        type=float,
        metavar="R",
        help="play at R times the recorded speed (default: 1; 0: as fast as possible)",
    )
    add_part_of_bag(parser)
    add("--reliable", action="store_true", help="subscribe reliably: the publisher must be reliable, too")
    add_record(parser)
    add_settings(parser)
    add("--overwrite", action="store_true", help="replace the contents of DIR")
    add("--namespace", metavar="NAME", help="ROS namespace of the nodes (default: none)")
    parser.set_defaults(**UNTOLD)


def _add_inspect(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("input", nargs="+", metavar="INPUT", help="LAS, LAZ or COPC files, bags, folders of them or globs")
    add("--json", action="store_true", help="print JSON, for scripts")


def _add_adjust(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("input", nargs="+", metavar="INPUT", help="LAS, LAZ or COPC files, folders of them or globs")
    add("--output", type=Path, metavar="DIR", help="new folder for copies with the strips shifted")
    weak = "with --output: withhold points whose intensity, 0 to 255 by strip, is less (default: 0, none)"
    add("--min-intensity", type=float, default=0.0, metavar="G", help=weak)
    add("--json", action="store_true", help="print JSON, for scripts")


def _add_simulate(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    switch = argparse.BooleanOptionalAction
    add("--output", type=Path, metavar="DIR", help="folder for the survey and its ground truth")
    add("--scene", default="village", metavar="NAME", help="scene (default: village)")
    add("--seed", type=int, default=0, metavar="N", help="random seed (default: 0)")
    add("--density", type=float, metavar="D", help="points per square metre")
    add("--overwrite", action="store_true", help="replace the contents of DIR")
    add("--live", action="store_true", help="publish scans and poses in real time")
    add("--bag", type=Path, metavar="DIR", help="write scans and poses to a ROS 2 bag")
    add(
        "--scanner",
        choices=("airborne", "vehicle"),
        default="airborne",
        help="platform of the scanner (default: airborne)",
    )
    add("--pulse-rate", type=float, metavar="N", help="pulses per second of the live scanner")
    add(
        "--details",
        action="store_true",
        help="let roofs hang over, and give walls windows and doors (always in street_canyon)",
    )
    add("--beams", type=int, metavar="N", help="vehicle: rays above one another (default: 32)")
    add("--top", type=float, metavar="DEG", help="vehicle: elevation of the highest ray (default: 20)")
    add("--profile", action="store_true", help="vehicle: one ray that turns in a tilted plane")
    add(
        "--pose-noise",
        type=_pair,
        metavar="M,DEG",
        help="vehicle: standard deviation of the poses' positions and angles (default: 0,0)",
    )
    add(
        "--pose-drift",
        type=_pair,
        metavar="M,DEG",
        help="vehicle: random walk of the poses in a second (default: 0,0)",
    )
    add(
        "--tf",
        action=switch,
        default=True,
        help="live: publish poses and mounting on /tf and /tf_static, too",
    )
    add("--fix", action="store_true", help="live: publish NavSatFix instead of map_origin")
    add("--wait", action=switch, default=True, help="live: wait for a subscriber to the scans")
    add("--reliable", action="store_true", help="live: publish scans reliably")
    add("--namespace", metavar="NAME", help="live: ROS namespace of the node (default: none)")


def _pair(text: str) -> tuple[float, float]:
    """Read two numbers with a comma between."""
    try:
        one, other = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be two numbers, such as 0.02,0.1") from None
    return one, other


def _simulate(options: argparse.Namespace) -> int:
    if options.live or options.bag or options.pulse_rate is not None or options.scanner == "vehicle":
        from lidar_buildings.commands.simulate_live import simulate_live_command

        return simulate_live_command(options)
    from lidar_buildings.simulation.survey import simulate_command

    return simulate_command(options)


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="output folder of a run")


def _add_serve(parser: argparse.ArgumentParser) -> None:
    _add_folder(parser)
    parser.add_argument(
        "--port", type=int, default=8000, metavar="N", help="port (default: 8000; 0: any free)"
    )


def _add_explain(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    _add_folder(parser)
    add(
        "building",
        metavar="BUILDING",
        help="readable_id, building_id, or coordinates X,Y (also where a building is missing)",
    )
    add("--page", type=Path, metavar="FILE", help="also write an HTML page about the building")


def _add_top(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--namespace", metavar="NAME", help="show only this graph (default: all)")
    add("--once", action="store_true", help="print one table and exit")
    add("--wait", type=float, default=10.0, metavar="S", help="time to wait for a graph [s] (default: 10)")


def _add_node(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("name", metavar="NAME", help="name such as ground_filter (see doc/nodes.md)")
    ros = "as `ros2 run` takes them, such as --ros-args -p output:=result"
    add("arguments", nargs=argparse.REMAINDER, metavar="...", help=ros)


def _add_warm_up(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quiet", action="store_true", help="print nothing at the end")


def _add_compare(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("old", type=Path, metavar="OLD", help="output folder of the earlier run")
    add("new", type=Path, metavar="NEW", help="output folder of the later one")
    add("--output", type=Path, metavar="FILE", help="GeoPackage of the changes (default: NEW/changes.gpkg)")
    height = "smallest elevation change of a roof, or four standard deviations of what did not change"
    add("--min-height", type=float, default=0.5, metavar="M", help=f"{height} [m] (default: 0.5)")
    add("--min-area", type=float, default=4.0, metavar="M2", help="smallest part of a roof [m²] (default: 4)")
    add("--json", action="store_true", help="print JSON with a row per change")


if __name__ == "__main__":
    console()
