"""Compiled loops: made in one way, and those without a way in from Python called by loops alone."""

import ast
from functools import cache

from support.source_tree import MODULES, ROOT, dotted, tree_of

DECORATORS = {"kernel"}
SOURCES = [*MODULES, *sorted((ROOT / "test").rglob("*.py")), *sorted((ROOT / "bench").rglob("*.py"))]
PATHS = {dotted(path): path for path in SOURCES}


def decorator_of(node):
    """The name of a loop's decorator, None for other functions."""
    if not isinstance(node, ast.FunctionDef):
        return None
    names = [ast.unparse(one) for one in node.decorator_list]
    return next((name for name in names if name in DECORATORS or "njit" in name), None)


@cache
def loops():
    """(module, name) → decorator of every loop of the package."""
    return {
        (dotted(path), node.name): decorator
        for path in MODULES
        for node in tree_of(path).body
        if (decorator := decorator_of(node)) is not None
    }


@cache
def imported_names(path):
    """Name in a module → where it comes from."""
    return {
        one.asname or one.name: (node.module, one.name)
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.ImportFrom) and node.module
        for one in node.names
    }


def origin(module, name):
    """Where a name comes from that a module may merely hand on."""
    path = PATHS.get(module)
    return origin(*imported_names(path)[name]) if path and name in imported_names(path) else (module, name)


def loops_used(path):
    """(loop, whether a loop uses it) for each use of a loop in a file."""
    tree, names = tree_of(path), imported_names(path)
    within = {id(part) for node in tree.body if decorator_of(node) is not None for part in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            used = origin(dotted(path), node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in names:
            used = origin(".".join(names[node.value.id]), node.attr)
        else:
            continue
        if used in loops():
            yield used, id(node) in within


@cache
def called_from_python():
    return {loop for path in SOURCES for loop, is_within in loops_used(path) if not is_within}


def test_loops_have_a_way_in_from_python_if_python_calls_them():
    wrong = {
        loop: kind
        for loop, kind in loops().items()
        if kind in DECORATORS and kind != ("kernel" if loop in called_from_python() else "kernel")
    }
    assert wrong == {}


def test_loops_are_compiled_in_the_ways_of_the_house():
    assert set(loops().values()) == DECORATORS
