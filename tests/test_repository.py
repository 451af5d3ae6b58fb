# SPDX-License-Identifier: Apache-2.0
"""The house rules that a machine can check, over every file that git knows."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LONGEST_FILE = 300
LONGEST_FUNCTION = 40
# What is longer says in itself why it stays in one piece: `// Long: a table of constants.`
EXPLAINED = re.compile(r"^\s*(?://|#) Long: \w", re.MULTILINE)

# A package may use those of the layers before its own. Modules beside the packages stand with the
# behaviors: they may use the first layer, and everybody may use them.
PYTHON_LAYERS = [
    ("recordings", "calibration", "models", "evaluation", "robots", "cameras", "simulation"),
    ("behaviors",),
    ("cli",),
]
# Packages of one layer that may be used by another of it.
NEIGHBOURS = {
    ("recordings", "calibration"),
    ("evaluation", "recordings"),
    ("evaluation", "calibration"),
    ("evaluation", "models"),
    ("simulation", "calibration"),
    ("robots", "calibration"),
    ("robots", "simulation"),
    ("cameras", "calibration"),
    ("cameras", "simulation"),
}
CPP_USES = {
    "geometry": set(),
    "tracking": {"geometry"},
    "estimation": {"geometry"},
    "odometry": {"geometry", "tracking", "estimation"},
    "reconstruction": {"geometry", "tracking", "estimation"},
    "rendering": {"geometry"},
}
PACKAGE_OF_MODULE = {"cv2": "opencv-python-headless", "yaml": "pyyaml"}


def _tracked() -> list[Path]:
    try:
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True
        ).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"not a git checkout: {error}", allow_module_level=True)
    return [path for name in listed.split("\0") if name and (path := ROOT / name).is_file()]


FILES = _tracked()
SOURCES = [f for f in FILES if f.suffix in {".py", ".pyi", ".cpp", ".hpp"}]
SCRIPTS = [
    f
    for f in FILES
    if f.suffix in {".cmake", ".sh"}
    or f.name in {"Makefile", "CMakeLists.txt"}
    or f.parent.name == ".ci"
]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return None


def _python_files() -> list[Path]:
    return [f for f in SOURCES if _name(f).startswith("src/pilotage/") and f.suffix == ".py"]


def _imports(path: Path) -> Iterator[str]:
    """Yield the dotted names of the modules a Python file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module


def _python_functions(path: Path) -> Iterator[tuple[str, int, int]]:
    """Yield name, first and last line of each function's body, after signature and docstring."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            before = node.body[0].lineno - 1
            if ast.get_docstring(node) is not None:
                before = node.body[0].end_lineno or before
            yield node.name, before + 1, node.end_lineno or before


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _cpp_functions(path: Path) -> Iterator[tuple[str, int, int]]:
    """Yield name, first and last line of each function, trusting clang-format's indentation."""
    lines = path.read_text().splitlines()
    start, indent, name = 0, -1, ""
    for number, line in enumerate(lines):
        if indent < 0 and line.endswith("{") and re.search(r"[)>]|const|noexcept", line):
            if re.match(r"\s*(namespace|class|struct|enum|union|extern|#)", line):
                continue
            begin = number
            while (
                begin > 0
                and re.match(r"\s*\S", lines[begin - 1])
                and not re.search(r"[;}{:>]$|^\s*//|^\s*#", lines[begin - 1])
            ):
                begin -= 1
            words = re.findall(r"([\w:~]+)\s*\(", "".join(lines[begin : number + 1]))
            start, indent = begin, _indent(lines[begin])
            name = words[0] if words else lines[begin].strip()
        elif indent >= 0 and _indent(line) == indent and line.lstrip().startswith("}"):
            yield name, start + 1, number + 1
            indent = -1


def test_every_source_names_its_licence() -> None:
    for path in SOURCES + SCRIPTS:
        head = path.read_text().splitlines()[:2]
        assert any("SPDX-License-Identifier: Apache-2.0" in line for line in head), _name(path)


def test_files_are_short_or_explained() -> None:
    long = {}
    for path in SOURCES:
        text = path.read_text()
        generated = path.name == "_core.pyi"
        if text.count("\n") > LONGEST_FILE and not generated and not EXPLAINED.search(text):
            long[_name(path)] = text.count("\n")
    assert not long, f"over {LONGEST_FILE} lines without a comment '// Long: why': {long}"


def test_functions_are_short_or_explained() -> None:
    long = {}
    for path in SOURCES:
        functions = _python_functions if path.suffix in {".py", ".pyi"} else _cpp_functions
        lines = path.read_text().splitlines()
        for name, first, last in functions(path):
            declarations = _name(path).startswith("bindings/") and name.startswith("bind_")
            explained = EXPLAINED.search("\n".join(lines[first - 2 : last]))
            if last - first >= LONGEST_FUNCTION and not declarations and not explained:
                long[f"{_name(path)}:{name}"] = last - first + 1
    assert not long, f"over {LONGEST_FUNCTION} lines without a comment '// Long: why': {long}"


def test_cpp_functions_are_seen(tmp_path: Path) -> None:
    body = "  x += 1;\n" * 50
    source = tmp_path / "a.cpp"
    source.write_text(f"namespace a {{\n\nint B::f(int x,\n         int y) {{\n{body}}}\n\n}}\n")
    assert list(_cpp_functions(source)) == [("B::f", 3, 55)]


def test_no_path_of_one_machine() -> None:
    pattern = re.compile(r"(?<![\w.])/(?:work|root|farm|home|tmp)/\w")
    for path in FILES:
        for number, line in enumerate((_text(path) or "").splitlines(), 1):
            assert not pattern.search(line), f"{_name(path)}:{number}: {line.strip()}"


def test_lock_is_hashed_and_names_no_index() -> None:
    lock = (ROOT / "requirements.lock").read_text()
    assert not re.search(r"https?:|index-url|find-links|trusted-host", lock)
    requirements = re.split(r"\n(?=[a-z])", lock)
    for requirement in requirements:
        assert "--hash=sha256:" in requirement, requirement.splitlines()[0]
    locked = {r.split("==")[0] for r in requirements}
    project, groups = PROJECT["project"], PROJECT["dependency-groups"]
    wanted = project["dependencies"] + groups["dev"] + PROJECT["build-system"]["requires"]
    for requirement in wanted:
        assert _distribution(requirement) in locked, f"{requirement}: run make lock"


def _distribution(requirement: str) -> str:
    return re.split(r"[<>=!~;\[ ]", requirement)[0].lower()


def test_imports_are_declared() -> None:
    declared = {_distribution(d) for d in PROJECT["project"]["dependencies"]}
    for path in _python_files():
        for module in _imports(path):
            top = module.split(".")[0]
            if top != "pilotage" and top not in sys.stdlib_module_names:
                package = PACKAGE_OF_MODULE.get(top, top)
                assert package in declared, f"{_name(path)} imports {top}"


def test_every_dependency_has_its_reason() -> None:
    architecture = (ROOT / "docs/architecture.md").read_text()
    groups = PROJECT["project"]["dependencies"] + PROJECT["dependency-groups"]["dev"]
    for requirement in groups:
        name = _distribution(requirement)
        if not name.startswith("types-"):
            assert f"`{name}`" in architecture, f"{name}: docs/architecture.md says no reason"


def test_python_imports_go_down() -> None:
    rank = {name: i for i, layer in enumerate(PYTHON_LAYERS) for name in layer}
    for path in _python_files():
        own = path.relative_to(ROOT / "src/pilotage").parts[0]
        for module in _imports(path):
            parts = module.split(".")
            if parts[0] != "pilotage" or len(parts) < 2 or parts[1] not in rank:
                continue
            used = parts[1]
            below = rank[used] < rank.get(own, 1) or used == own or (own, used) in NEIGHBOURS
            assert below, f"{_name(path)} imports {module}, which is not below it"


def test_cpp_includes_go_down() -> None:
    for path in SOURCES:
        parts = Path(_name(path)).parts
        if parts[0] != "cpp" or len(parts) < 3:
            continue
        for used in re.findall(r'#include "(\w+)/', path.read_text()):
            allowed = CPP_USES[parts[1]] | {parts[1]}
            assert used in allowed, f"{_name(path)} includes {used}/"


def test_readme_shows_every_verb() -> None:
    from pilotage.cli.main import app

    readme = (ROOT / "README.md").read_text()
    verbs = [c.name or c.callback.__name__.replace("_", "-") for c in app.registered_commands]
    assert verbs
    for verb in verbs:
        assert f"pilotage {verb}" in readme, verb


def test_documents_name_what_exists() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for path in (f for f in FILES if f.suffix == ".md"):
        text = path.read_text()
        for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
            assert (path.parent / link).exists(), f"{_name(path)} links to {link}"
        for words in re.findall(r"`make ([a-z -]+)", text):
            assert set(words.split()) <= targets, f"{_name(path)}: make {words}"
