"""The house has floors: each package imports only what stands below it, function-level imports included."""

import ast
from pathlib import Path

import pytest

import dynid

ROOT = Path(dynid.__file__).parent

# From the ground up; a package may import every floor below its own, and none beside it.
FLOORS = [
    {"_version", "errors", "words", "numerals", "atomic", "inputs", "hdf5"}
    | {"result", "need", "choices", "progress"},
    {"lti"},
    {"bondgraph", "structure"},
    {"identification"},
    {"scene"},
    {"store", "checks", "templates", "topics"},
    {"study"},
    {"bench"},
    {"report"},
    {"building", "cli", "__init__"},
    {"__main__"},
]
# What is allowed besides, or forbidden although it stands below.
BESIDES = {
    ("need", "result"),
    ("result", "errors"),
    ("result", "words"),
    ("atomic", "errors"),
    ("hdf5", "errors"),
    ("__init__", "_version"),
    ("__init__", "building"),
}
FORBIDDEN = {
    ("identification", "bondgraph"),
    *(("store", package) for package in ("lti", "bondgraph", "structure", "identification", "scene")),
    *(("checks", package) for package in ("lti", "bondgraph", "structure", "identification")),
    *(("cli", package) for package in ("lti", "bondgraph", "structure", "identification")),
    *(("study", package) for package in ("lti", "bondgraph", "structure", "identification")),
}
# The store and the checks know nothing of scenes but how to suggest a name.
SUGGESTIONS = "dynid.scene.yaml.source"

# Who may import a library, and for what.
LIBRARIES = {
    "click": {"cli"},  # commands
    "rich": {"cli"},  # tables on the screen
    "h5py": {"hdf5", "store", "scene.kinds.hdf5_table", "structure.readers.hdf5"},  # results; users' data
    "yaml": {"scene"},
    "pydantic": {"scene"},
    "pydantic_core": {"scene"},
    "sympy": {"bondgraph", "bench"},  # formulas
    "flint": {"lti", "bondgraph", "bench"},  # exact numbers
    "control": {"result", "bench"},  # state equations for users' hands; a peer
    "xarray": {"result"},
    "typst": {"report.formats"},
    "matplotlib": set(),  # figures are written as SVG
    "numba": {"lti", "identification", "bondgraph.algebra.doubled"},
}


def imports_of(path):
    """Yield every module that a file imports, wherever in it; a name imported from a package as a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            if node.module == "dynid":
                yield from (f"dynid.{alias.name}" for alias in node.names)
            else:
                yield str(node.module)


def module_of(path):
    """Return a file's place in the house, such as `scene.kinds.hdf5_table`."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


MODULES = {module_of(path): sorted(set(imports_of(path))) for path in sorted(ROOT.rglob("*.py"))}
EDGES = [
    (module, name)
    for module, names in MODULES.items()
    for name in names
    if name == "dynid" or name.startswith("dynid.")
]


def package_of(name):
    return name.removeprefix("dynid.").partition(".")[0]


def floor_of(package):
    return next((number for number, floor in enumerate(FLOORS) if package in floor), None)


def test_every_package_has_its_floor():
    assert {package_of(module) for module in MODULES} <= set().union(*FLOORS)


@pytest.mark.parametrize("package", sorted({package_of(module) for module in MODULES}))
def test_a_package_imports_only_floors_below(package):
    for module, name in EDGES:
        other = package_of(name)
        if package_of(module) != package or other == package or (package, other) in BESIDES:
            continue
        assert floor_of(other) is not None, f"{module} imports {name}"
        assert floor_of(other) < floor_of(package), f"{module} imports {name}, which is no floor below"
        assert (package, other) not in FORBIDDEN, f"{module} imports {name}"


def test_checks_know_nothing_of_scenes_but_how_to_suggest_a_name():
    known = {name for module, name in EDGES if package_of(module) == "checks" and package_of(name) == "scene"}
    assert known <= {SUGGESTIONS}


@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_is_imported_only_where_it_belongs(library):
    users = {
        module for module, names in MODULES.items() for name in names if name.partition(".")[0] == library
    }
    allowed = LIBRARIES[library]
    assert {user for user in users if user not in allowed and package_of(user) not in allowed} == set()


def test_packages_import_each_other_in_no_circle():
    below = {package_of(module): set() for module in MODULES}
    for module, name in EDGES:
        below[package_of(module)].add(package_of(name))
    order = []
    while ready := [
        package
        for package, needs in below.items()
        if needs - {package} <= set(order) and package not in order
    ]:
        order += ready
    assert sorted(order) == sorted(below)


# Lines of a function, its docstring apart: what is longer is several things. Where it is not, why:
LONGEST = 35
LONGER = {
    "cli.study.study": "half of it are the names of its options",
    "identification.kernels.simulate.sensitive": "machine code: handing arrays over takes longer than a step",
    "identification.kernels.walk.walk": "machine code, as above",
    "bench.cases.suspension.by_filterpy": "a peer's filter as its users write it",
    "bench.cases.suspension.by_dynamax": "a peer's filter as its users write it",
}


def lengths_of(path):
    """Yield every function of a file, with its lines less those of its docstring."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            told = node.body[0] if ast.get_docstring(node, clean=False) is not None else None
            said = told.end_lineno - told.lineno + 1 if told else 0
            yield f"{module_of(path)}.{node.name}", node.end_lineno - node.lineno + 1 - said


def test_functions_are_short():
    long = {name: lines for path in ROOT.rglob("*.py") for name, lines in lengths_of(path) if lines > LONGEST}
    assert {name: lines for name, lines in long.items() if name not in LONGER} == {}
    assert set(LONGER) <= set(long), "these are short enough by now"
