"""The package's source as syntax trees: its modules, and what they import."""

import ast
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "lidar_buildings"

MODULES = sorted(PACKAGE.rglob("*.py"))
LAUNCH_FILES = sorted((ROOT / "launch").glob("*.py"))


def dotted(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


NAMES = {dotted(path) for path in MODULES}


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def imports_of(tree, package):
    """
    Every module that is imported, wherever the statement stands.

    `from a import b` gives a.b if that is a module of the package, else a.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            for alias in node.names:
                full = f"{base}.{alias.name}"
                yield full if full in NAMES else base


def package_of(path):
    return dotted(path) if path.name == "__init__.py" else dotted(path).rpartition(".")[0]


def external_imports(path):
    roots = {name.split(".")[0] for name in imports_of(tree_of(path), package_of(path))}
    return roots - sys.stdlib_module_names - {"lidar_buildings"}
