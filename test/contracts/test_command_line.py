"""The page of the command line says what the parser knows."""

from pathlib import Path

from bench.pages.command_line import page

PAGE = Path(__file__).parents[2] / "doc" / "command_line.md"


def test_the_page_of_the_command_line_is_that_of_the_parser():
    assert PAGE.read_text(encoding="utf-8") == page(), "write it anew: make reference"
