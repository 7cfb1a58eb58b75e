"""The scripts of shells know commands, options and the few values that some have."""

import subprocess

import pytest
from support.cli_runs import Command

from lidar_buildings.commands.terminal import coloured

COMPLETE = """source {script}
complete_of() {{ COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
$(complete -p lidar-buildings | sed 's/.*-F \\([^ ]*\\).*/\\1/') x "${{@: -1}}" "${{@: -2:1}}"
echo "${{COMPREPLY[@]}}"; }}
"""


def test_bash_completes_commands_options_and_values(capfd, tmp_path):
    script = tmp_path / "script"
    script.write_text("\n".join(Command(capfd)("completion", "bash").out))
    lines = ["lidar-buildings expl", "lidar-buildings run --over", "lidar-buildings run --preset vil"]
    calls = COMPLETE.format(script=script) + "\n".join(f"complete_of {line}" for line in lines)
    done = subprocess.run(["bash", "-c", calls], capture_output=True, text=True, check=True)
    assert [one.strip() for one in done.stdout.splitlines()] == ["explain", "--overwrite", "villalba"]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_scripts_too(capfd, shell):
    spoken = Command(capfd)("completion", shell)
    assert any("retry-failed" in line for line in spoken.out)


class Terminal:
    def isatty(self):
        return True


def test_colours_are_for_terminals_that_want_them(monkeypatch):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    assert coloured("1 good", "green", Terminal()) == "\x1b[32m1 good\x1b[0m"
    monkeypatch.setenv("NO_COLOR", "1")
    assert coloured("1 good", "green", Terminal()) == "1 good"
    assert coloured("1 good", "green", None) == "1 good"
