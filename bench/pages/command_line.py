"""
Write the page of the command line anew from the parser: each command with its options.

    python -m bench.pages.command_line doc/command_line.md
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from lidar_buildings.cli import command_parser

HEAD = """# The command line

`lidar-buildings COMMAND`. Exit status 0; 1 for a defect of the program; 2 for wrong use or input that cannot
be read (one line on stderr: which, why, what to do); 3 when a tile failed and the
rest was done; 4 when all was done, but there is
something to look at first (`run --strict`: a building whose [quality](quality.md) is not good; more than 5 %
of the points of a bag or feed left out); 130 when it was interrupted (Ctrl-C, SIGTERM, a terminal that is
closed).

`make reference` writes this page from what `--help` says.
"""


def page() -> str:
    """Return the whole page."""
    return HEAD + "".join(map("\n{}\n".format, _lines(command_parser())))


def _lines(parser: argparse.ArgumentParser) -> Iterator[str]:
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    for choice in commands._choices_actions:
        yield f"## {choice.dest}\n\n{_sentence(choice.help or '')}\n\n{_table(commands.choices[choice.dest])}"


def _table(parser: argparse.ArgumentParser) -> str:
    rows = [
        f"| `{_spelling(action)}` | {(action.help or '').replace('|', chr(92) + '|')} |"
        for action in sorted(parser._actions, key=lambda action: bool(action.option_strings))
        if not isinstance(action, argparse._HelpAction)
    ]
    return "\n".join(["| argument | meaning |", "|---|---|", *rows])


def _spelling(action: argparse.Action) -> str:
    """Return an argument as a user writes it."""
    name = action.metavar or "{" + ",".join(map(str, action.choices or ())) + "}"
    if not action.option_strings:
        return f"{name}..." if action.nargs == "+" else str(name)
    spelling = ", ".join(action.option_strings)
    names = " ".join(name) if isinstance(name, tuple) else name
    return spelling if action.nargs == 0 else f"{spelling} {names}"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(), encoding="utf-8")
