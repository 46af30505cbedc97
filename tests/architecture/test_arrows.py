"""The rooms of the house and who may import whom, read from the sources."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CERTIFICATE = {
    f"planner.{name}"
    for name in ("body_gauges", "errors", "gauges", "kernels", "nearest", "problem", "rolling", "schedule",
                 "tolerances", "verify")
} | {"planner"}  # fmt: skip
"""The only modules beside drives that the certificate may load."""
ROOMS = ("drives", "planner", "api")
SOURCES = {
    ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): file
    for room in ROOMS
    for file in sorted((ROOT / room).rglob("*.py"))
}


@cache
def imports(module: str) -> set[str]:
    """The modules that a module imports: `from a import b` counts as a, and as a.b where that is one."""
    return set(_imports(module, ast.parse(SOURCES[module].read_text(encoding="utf-8"))))


def _imports(module: str, tree: ast.Module) -> Iterator[str]:
    package = module if SOURCES[module].name == "__init__.py" else module.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, *([base] if base else [])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names if f"{base}.{alias.name}" in SOURCES)


def roots(module: str) -> set[str]:
    return {name.partition(".")[0] for name in imports(module)}


def importers(library: str) -> set[str]:
    return {module for module in SOURCES if library in roots(module)}


def room(name: str) -> list[str]:
    return [module for module in SOURCES if module.partition(".")[0] == name]


def reach(module: str) -> set[str]:
    """The modules of ours that a module imports, itself or through others."""
    found: set[str] = set()
    todo = [module]
    while todo:
        for name in imports(todo.pop()) & SOURCES.keys() - found:
            found.add(name)
            todo.append(name)
    return found


def test_the_sources_are_here() -> None:
    assert {module.partition(".")[0] for module in SOURCES} == set(ROOMS)
    assert {"planner.plan", "planner.verify", "drives.drive", "api.app"} <= SOURCES.keys()


@pytest.mark.parametrize(
    ("library", "modules"),
    [
        ("ompl", {"planner.search"}),
        ("toppra", {"planner.time_law"}),
        ("ruckig", {"planner.time_law"}),
        ("casadi", {"planner.optimal_control", "planner.retime", "planner.stagewise", "planner.tape"}),
    ],
)
def test_a_library_stays_behind_its_doors(library: str, modules: set[str]) -> None:
    assert importers(library) == modules


@pytest.mark.parametrize("module", [*room("drives"), *room("planner")])
def test_imports_are_written_out(module: str) -> None:
    calls = [n for n in ast.walk(ast.parse(SOURCES[module].read_text("utf-8"))) if isinstance(n, ast.Call)]
    assert not {"import_module", "importlib.import_module", "__import__"} & {
        ast.unparse(c.func) for c in calls
    }


@pytest.mark.parametrize("module", room("drives"))
def test_drives_know_arrays_and_themselves_only(module: str) -> None:
    assert roots(module) - sys.stdlib_module_names <= {"drives", "numpy", "numba"}


@pytest.mark.parametrize("module", room("planner"))
def test_planner_knows_nothing_of_http(module: str) -> None:
    assert not roots(module) & {"api", "fastapi", "pydantic", "starlette", "uvicorn", "orjson"}


@pytest.mark.parametrize("module", room("planner"))
def test_planner_knows_no_drive_by_name(module: str) -> None:
    """A new drive needs no edit here: all goes through the contract. warm_up is an example, not a use."""
    contract = {"drives", "drives.drive", "drives.kernels", "drives.se2", "drives.wheel"}
    assert {name for name in imports(module) if name.partition(".")[0] == "drives"} <= contract
    if module != "planner.warm_up":
        assert "drives" not in imports(module)


def loaded(module: str) -> set[str]:
    """The modules of ours that importing a module loads, itself included: `import a.b` loads a, too."""
    found: set[str] = set()
    todo = {module}
    while todo:
        name = todo.pop()
        found.add(name)
        parents = {name[:k] for k, letter in enumerate(name) if letter == "."}
        todo |= (imports(name) | parents) & SOURCES.keys() - found
    return found


def test_the_certificate_loads_nothing_of_the_planner_but_what_is_listed() -> None:
    found = loaded("planner.verify")
    assert {name for name in found if name.partition(".")[0] != "drives"} == CERTIFICATE
    assert {name.partition(".")[0] for name in found} == {"drives", "planner"}
    libraries = set.union(*map(roots, found)) - sys.stdlib_module_names
    assert libraries == {"drives", "numba", "numpy", "planner"}


def test_problem_and_errors_know_drives_only() -> None:
    for module in ("planner.problem", "planner.errors"):
        assert all(name.partition(".")[0] == "drives" for name in reach(module))


def test_modules_do_not_import_each_other_in_a_circle() -> None:
    for module in SOURCES:
        if SOURCES[module].name != "__init__.py":
            assert module not in reach(module), module
