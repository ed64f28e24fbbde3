"""Scenes of kind `study`, and the scenes they vary."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn, cast

from dynid.errors import FileError, SceneError, UsageError
from dynid.scene.kinds.study_faults import refused, study_faults
from dynid.scene.load import Scene, check_source
from dynid.scene.schema.study import StudyScene
from dynid.scene.yaml.source import read_source

if TYPE_CHECKING:
    from dynid.result import Result


def run(scene: Scene) -> Result:
    """Refuse to run a study as one scene."""
    return _refuse(scene)


def _refuse(scene: Scene) -> NoReturn:
    raise UsageError(
        "this is a study: many runs of a scene", remedy=f"Run it with: dynid study {scene.source.file}"
    )


def study_model(scene: Scene) -> StudyScene:
    """Return what a study says.

    Raises
    ------
    UsageError
        Where the scene is none.
    """
    if scene.kind != "study":
        problem = f"{scene.source.file} is a scene of kind {scene.kind}, not a study"
        raise UsageError(problem, remedy=f"Run it with: dynid run {scene.source.file}")
    return cast("StudyScene", scene.model)


def base_scene(scene: Scene) -> Scene:
    """Load the scene that a study varies.

    Raises
    ------
    FileError
        Where it cannot be read.
    SceneError
        With all faults of it.
    """
    source = read_source(scene.folder / study_model(scene).scene)
    if (
        isinstance(source.data, dict) and source.data.get("kind") == "study"
    ):  # told before it is checked: a chain of studies may be a circle
        message = "this is a study itself; a study varies another scene"
        raise SceneError([scene.source.fault(("scene",), message)])
    return check_source(source)


def check_study(scene: Scene) -> None:
    """Check what a study says as a whole, and whether the scene it varies takes what it sets.

    Raises
    ------
    FileError
        Where the scene it varies cannot be read.
    SceneError
        With all faults of the study, or those of the scene it varies.
    """
    model = study_model(scene)
    faults = [scene.source.fault(path, message) for path, message in study_faults(model)]
    try:
        base = base_scene(scene)
    except FileError as error:
        raise FileError(str(scene.source.fault(("scene",), str(error)))) from None
    except SceneError as error:
        raise SceneError([*faults, *error.faults]) from None
    if not faults:
        faults = list(refused(scene, model, base))
    if faults:
        raise SceneError(faults)
