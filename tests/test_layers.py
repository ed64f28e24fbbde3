"""The layers of the packages: each imports only layers below its own, function-level imports included.

The page on architecture, and its picture, show them as they are.
"""

import ast
import importlib.util
import re
from functools import cache
from pathlib import Path

import pytest

import dynid
from tests.test_theory import named, place

ROOT = Path(dynid.__file__).parent
DOCS = Path(__file__).parents[1] / "docs"
PAGE = DOCS / "architecture.md"

# From the lowest up; a package may import every layer below its own, and none beside it.
LAYERS = [
    {"_version", "arrays", "errors", "suggestions", "number_format", "file_access", "trial", "hdf5"}
    | {"result", "model_scope", "defaults", "native", "progress", "units"},
    {"arithmetic"},
    {"parameters"},
    {"lti"},
    {"structure"},
    {"bondgraph"},
    {"identification"},
    {"files", "library", "modal"},
    {"scene"},
    {"store", "checks", "templates", "topics"},
    {"study"},
    {"bench"},
    {"report"},
    {"builders", "cli", "__init__"},
    {"__main__"},
]
# Imports allowed within a layer; imports forbidden although the layer is lower.
WITHIN = {
    ("model_scope", "result"),
    ("arrays", "errors"),
    ("result", "errors"),
    ("result", "suggestions"),
    ("file_access", "errors"),
    ("hdf5", "errors"),
    ("hdf5", "trial"),
    ("native", "errors"),
    ("units", "errors"),
    ("__init__", "_version"),
    ("__init__", "builders"),
}
FORBIDDEN = {
    *(("store", package) for package in ("lti", "bondgraph", "structure", "identification", "scene")),
    *(("checks", package) for package in ("lti", "bondgraph", "structure", "identification")),
    *(("cli", package) for package in ("lti", "bondgraph", "structure", "identification")),
    *(("study", package) for package in ("lti", "bondgraph", "structure", "identification")),
}
# The checks use one module of the scenes: the text with positions, for messages.
SUGGESTIONS = "dynid.scene.yaml.source"

# The packages that may import a library, and what for.
LIBRARIES = {
    "click": {"cli"},  # commands
    "rich": {"cli"},  # tables on the screen
    "h5py": {"hdf5", "store", "files.hdf5_data"},  # results; users' data
    "yaml": {"scene", "bench"},  # scenes; a peer
    "pydantic": {"scene"},
    "pydantic_core": {"scene"},
    "sympy": {"bondgraph", "bench"},  # formulas
    "flint": {"arithmetic", "lti", "bondgraph", "bench"},  # exact numbers
    "filelock": {"study"},  # one writer of a file
    "control": {"result", "bench", "bondgraph"},  # state equations for users; a peer; gains of states
    "xarray": {"result"},
    "pandas": {"result", "report.notebook"},
    "typst": {"report.figure"},
    "meshio": {"files.meshio_mesh"},
    "nptdms": {"files.recorder_files"},
    "openpyxl": {"files.spreadsheet"},
    "skfem": set(),  # an oracle of tests
    "matplotlib": {"report.notebook"},  # files of figures are written as SVG
}


@cache
def statements(path):
    """Return the statements of a file that import, wherever in it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]


def imports_of(path):
    """Yield every module that a file imports, wherever in it; a name imported from a package as a module."""
    for node in statements(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        else:
            assert node.level == 0, f"{path}: imports are absolute"
            if node.module == "dynid":
                yield from (f"dynid.{alias.name}" for alias in node.names)
            else:
                yield str(node.module)


def module_of(path):
    """Return the dotted name of a file, such as `tables.binary`."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


@cache
def modules():
    """Return the imports of every module."""
    return {module_of(path): sorted(set(imports_of(path))) for path in sorted(ROOT.rglob("*.py"))}


def edges():
    """Return the pairs of modules of which one imports the other."""
    return [
        (module, name)
        for module, names in modules().items()
        for name in names
        if name == "dynid" or name.startswith("dynid.")
    ]


def package_of(name):
    return name.removeprefix("dynid.").partition(".")[0]


def layer_of(package):
    return next((number for number, layer in enumerate(LAYERS) if package in layer), None)


@pytest.mark.thorough
def test_every_package_has_its_layer():
    assert {package_of(module) for module in modules()} <= set().union(*LAYERS)


@pytest.mark.parametrize("package", sorted({package_of(module_of(path)) for path in ROOT.rglob("*.py")}))
def test_a_package_imports_only_layers_below(package):
    for module, name in edges():
        other = package_of(name)
        if package_of(module) != package or other == package or (package, other) in WITHIN:
            continue
        assert layer_of(other) is not None, f"{module} imports {name}"
        assert layer_of(other) < layer_of(package), f"{module} imports {name}, which is in no lower layer"
        assert (package, other) not in FORBIDDEN, f"{module} imports {name}"


def test_checks_use_one_module_of_the_scenes():
    known = {
        name for module, name in edges() if package_of(module) == "checks" and package_of(name) == "scene"
    }
    assert known <= {SUGGESTIONS}


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_is_imported_only_where_it_belongs(library):
    users = {
        module for module, names in modules().items() for name in names if name.partition(".")[0] == library
    }
    allowed = LIBRARIES[library]
    assert {user for user in users if user not in allowed and package_of(user) not in allowed} == set()


def test_packages_import_each_other_in_no_circle():
    below = {package_of(module): set() for module in modules()}
    for module, name in edges():
        below[package_of(module)].add(package_of(name))
    order = []
    while ready := [
        package
        for package, needs in below.items()
        if needs - {package} <= set(order) and package not in order
    ]:
        order += ready
    assert sorted(order) == sorted(below)


def modules_imported(path):
    """Yield the modules of dynid that a file imports anywhere, for types too; a name may be a module."""
    names = {name: f"dynid.{name}" if name != "__init__" else "dynid" for name in modules()}
    known = set(names.values())
    for node in statements(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif node.module in known:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in known else node.module


def circles(graph):
    """Return the strongly connected components of more than one module (Tarjan)."""
    index, low, stack, found = {}, {}, [], []

    def visit(module):
        index[module] = low[module] = len(index)
        stack.append(module)
        for other in graph[module]:
            if other not in index:
                visit(other)
            if other in stack:
                low[module] = min(low[module], low[other])
        if low[module] == index[module]:
            place = stack.index(module)
            component = stack[place:]
            del stack[place:]
            if len(component) > 1:
                found.append(frozenset(component))

    for module in graph:
        if module not in index:
            visit(module)
    return set(found)


def test_modules_import_each_other_in_no_circle():
    graph = {}
    for path in sorted(ROOT.rglob("*.py")):
        module = "dynid" if module_of(path) == "__init__" else f"dynid.{module_of(path)}"
        graph[module] = sorted(set(modules_imported(path)) - {module})
    assert circles(graph) == set()


@pytest.fixture(scope="module")
def architecture():
    spec = importlib.util.spec_from_file_location("architecture", DOCS / "architecture.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_names_every_package_and_no_other():
    rows = re.findall(r"^\| (?:top|lowest)? ?\| (.*?) \|", PAGE.read_text(), re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", " ".join(rows))) == {package_of(module) for module in modules()}


def test_what_the_page_names_exists():
    folders = re.findall(r"`([a-z_]+/(?:\w+/)*)`", PAGE.read_text())
    for path in [*(path for path, _ in named(PAGE)), *folders]:
        found = place(path)  # a folder emptied of its modules may still hold their bytecode
        assert found.is_file() or any(found.rglob("*.py")), path


def test_the_picture_has_all_packages_and_imports(architecture):
    drawn = architecture.draw()
    assert set(re.findall(r'data-package="(\w+)"', drawn)) == {package_of(module) for module in modules()}
    lines = {tuple(edge.split()) for edge in re.findall(r'data-edge="([\w ]+)"', drawn)}
    assert lines == set(architecture.IMPORTS)


def test_no_line_of_the_picture_ends_beside_its_box(architecture):
    boxes, lanes = architecture.boxes(), architecture.lanes(architecture.boxes())
    assert set(lanes) == set(architecture.IMPORTS)
    for (package, other), x in lanes.items():
        assert boxes[other].x < x < boxes[other].x + boxes[other].width
        assert boxes[package].y + boxes[package].height < boxes[other].y
