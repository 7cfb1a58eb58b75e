"""Every public name of the core says what it is, in the form of the house."""

import ast
import importlib
import pkgutil
import re
from pathlib import Path

import pytest
from support.source_tree import tree_of

import lidar_buildings.core

CORE = Path(lidar_buildings.core.__file__).parent
#: As in pyproject.toml.
LINE_LENGTH = 110
MODULES = sorted(CORE.rglob("*.py"))


def public_definitions(tree):
    """The module itself, and every public function, class and method, by dotted name."""
    yield "module", tree
    pending = [("", node) for node in tree.body]
    while pending:
        prefix, node = pending.pop()
        if not isinstance(
            node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
        ) or node.name.startswith("_"):
            continue
        yield prefix + node.name, node
        if isinstance(node, ast.ClassDef):
            pending.extend((f"{prefix}{node.name}.", member) for member in node.body)


def fault(node):
    """Say what is wrong with a definition's docstring, None if nothing is."""
    text = ast.get_docstring(node, clean=False)
    if text is None:
        return "has no docstring"
    lines = text.split("\n")
    paragraphs = re.split(r"\n\s*\n", text.strip())
    summary = " ".join(paragraphs[0].split())
    if not summary.endswith((".", "?")):
        return f"has a summary that is no sentence: {summary}"
    if len(lines) == 1:
        return None
    if lines[0].strip() or not lines[1].strip():
        return "does not have its summary on the second line"
    if lines[-1].strip() or not lines[-2].strip():
        return "does not have its closing quotes on the line below its text"
    column = getattr(node, "col_offset", -4) + 4
    if len(paragraphs) == 1 and len(summary) + 6 + column <= LINE_LENGTH:
        return "takes more than one line for one sentence"
    return None


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(CORE)))
def test_every_public_name_of_the_core_has_a_docstring_in_the_house_s_form(path):
    faults = {
        name: wrong for name, node in public_definitions(tree_of(path)) if (wrong := fault(node)) is not None
    }
    assert faults == {}


def test_every_module_of_the_core_can_be_imported_alone():
    names = [m.name for m in pkgutil.walk_packages(lidar_buildings.core.__path__, "lidar_buildings.core.")]
    assert len(names) >= len(MODULES) - 1
    for name in names:
        assert importlib.import_module(name).__doc__
