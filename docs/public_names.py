"""The public names of packages, read from their sources."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path


def public_names(package: str) -> list[str]:
    """Return the names that a package or module defines without an underscore, or imports ``as`` themselves."""
    spec = find_spec(package)
    assert spec is not None and spec.origin is not None
    stub = Path(spec.origin).with_suffix(".pyi")
    source = (stub if stub.is_file() else Path(spec.origin)).read_text(encoding="utf-8")
    names = set(_names(ast.parse(source).body))
    return sorted(name for name in names if not name.startswith("_"))


def _names(body: list[ast.stmt]) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.If):
            yield from _names([*node.body, *node.orelse])
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.name for alias in node.names if alias.asname == alias.name)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (target.id for target in targets if isinstance(target, ast.Name))
