"""The commands of tutorials and how-tos do what the pages say: all are run, and what they print compared."""

import re
import shlex

import pytest
from support.cli_runs import Command
from support.source_tree import ROOT

PAGES = ["tutorial_tiles", "tutorial_bag", "howto"]
BLOCK = re.compile(r"^```(console|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def spoken(command, line):
    """All that a command prints; runs go without the graph, which writes the same files and starts slower."""
    words = shlex.split(line)
    assert words[0] == "lidar-buildings"
    said = command(*words[1:], *(["--no-ros"] if words[1] == "run" else []))
    assert said.status == 0, (line, said.err)
    return said.out + said.err


def follow(command, block):
    """Run the commands of a block; … stands for any text in the lines shown, and for lines left out."""
    for part in re.split(r"^\$ ", block.replace("\\\n", ""), flags=re.MULTILINE)[1:]:
        line, *shown = part.splitlines()
        said = iter(spoken(command, line))
        for told in shown:
            wanted = ".*".join(re.escape(piece.strip()) for piece in told.split("…"))
            assert any(re.fullmatch(rf"\s*{wanted}\s*", one) for one in said), (line, told)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_the_page_is_true(page, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = BLOCK.findall((ROOT / "doc" / f"{page}.md").read_text(encoding="utf-8"))
    assert blocks
    for language, block in blocks:
        if language == "python":
            exec(block, {})
        else:
            follow(Command(capfd), block)
