"""dynid: bond graphs in the frequency domain, and joint identification on reduced FE models.

Examples
--------
>>> import dynid
>>> scene = dynid.load_scene("configs/isolator.yaml")
>>> result = dynid.run(scene)
>>> result.value("bond_graph/properties/m_s.f/v_in/dc_gain")
1.0
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynid._version import __version__
from dynid.builders import GraphBuilder, StructureBuilder, scene_from

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping
    from types import ModuleType
    from typing import Any

    from dynid import checks, errors, lti, report, store
    from dynid.result import Result
    from dynid.scene.load import Scene

__all__ = [
    "GraphBuilder",
    "StructureBuilder",
    "__version__",
    "checks",
    "errors",
    "load_scene",
    "lti",
    "open_result",
    "report",
    "run",
    "scene_from",
    "store",
    "write_result",
]


def __getattr__(name: str) -> ModuleType:
    """Import a public package at its first use, so that ``import dynid`` stays quick."""
    if name in __all__:
        from importlib import import_module

        return import_module(f"dynid.{name}")
    raise AttributeError(f"module 'dynid' has no attribute {name!r}")


def load_scene(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    path
        The YAML file.
    overrides
        Values to set before checking, each as `a.b=1`.

    Raises
    ------
    dynid.errors.FileError
        Where the file cannot be read.
    dynid.errors.SceneError
        With all faults of the scene, each with line and column.
    """
    from dynid.scene.load import load_scene as load

    return load(path, overrides)


def run(
    scene: Scene | str | os.PathLike[str], data: Mapping[str, Mapping[str, Any] | Any] | None = None
) -> Result:
    """Run a scene, or the scene in a file; nothing is written, and the scene's `expect` is not evaluated.

    `dynid.write_result` writes the result; `dynid.checks.check_expectations` evaluates expectations.

    Parameters
    ----------
    scene
        The scene, or its YAML file.
    data
        Arrays in place of files that the scene names, by their names there: columns of numbers (n) by name,
        as ``{"logger.csv": {"time": t, "A3": a3}}``, in the unit that the name has in brackets; matrices
        (n x n), full or sparse, by name or one alone; frequency responses, complex, with their frequencies.

    Raises
    ------
    dynid.errors.UsageError
        Where the scene names no such file, or what is supplied are no arrays of numbers.
    dynid.errors.NumericalError
        Where the question has no trustworthy answer (singular, diverged, not identifiable). Where a fit was
        rejected, `result` of the error shows it: measured, predicted and diagnostics.
    dynid.errors.FileError
        Where a file that the scene names cannot be read.
    """
    from dynid.scene.load import Scene
    from dynid.scene.run import run_scene

    loaded = scene if isinstance(scene, Scene) else load_scene(scene)
    if data is None:
        result = run_scene(loaded)
    else:
        from dynid.file_access import supplying
        from dynid.scene.files import supplied_arrays

        with supplying(supplied_arrays(loaded, data)):
            result = run_scene(loaded)
    if getattr(loaded.model, "accuracy", None) is not None:
        from dynid.bench.scenes import add_accuracy

        add_accuracy(result, loaded)
    return result


def open_result(path: str | os.PathLike[str]) -> Result:
    """Read a result back from its HDF5 file.

    Raises
    ------
    dynid.errors.FileError
        Where it is no complete result of a known format.
    """
    from dynid.store import read_result

    return read_result(path)


def write_result(result: Result, path: str | os.PathLike[str]) -> None:
    """Write a result to an HDF5 file as `dynid run` does: whole or not at all; an existing file is replaced.

    Raises
    ------
    dynid.errors.FileError
        Where the file cannot be written; an existing file is untouched then.
    """
    from dynid.store import write_result as write

    write(result, path)
