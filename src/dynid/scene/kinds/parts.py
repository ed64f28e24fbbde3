"""The structure of an identification: one or several parts, points, and joints between DOFs or points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.scene.kinds.parameters import all_parameters
from dynid.scene.kinds.structures import (
    bare_structure,
    build_structure,
    dof_joint,
    joint_laws,
    joint_offset,
    joint_parameter,
    with_units,
)
from dynid.scene.schema.joints import Axes, AxesModel, JointModel
from dynid.scene.schema.references import dof_faults
from dynid.structure.joints import Joint
from dynid.structure.labels import Label, Nodes
from dynid.structure.model import StructuralModel
from dynid.structure.named_dofs import Motion
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.parts import PointModel
    from dynid.structure.points import Point


def structure_of(scene: Scene[IdentificationScene]) -> StructuralModel:
    """Return the structure of an identification with its points and joints.

    Raises `SceneError` if the scene names DOFs that the structure does not have. Raises `FileError` or
    `UsageError` as `build_structure`; if a point or a joint between points makes no sense.
    """
    model = scene.model
    if model.structure is not None and not (model.points or model.motions):
        return build_structure(scene, model.structure, model.joints)
    assembly = _bare(scene, model)
    from dynid.structure.points import with_points

    points = [_point(name, point, model, assembly.nodes) for name, point in model.points.items()]
    assembly, placed = with_points(assembly, points)
    joints: list[Joint] = []
    motions: dict[str, Motion] = {}
    for name, joint in model.joints.items():
        if joint.points is None:
            joints.append(dof_joint(name, joint))
            continue
        from dynid.structure.point_joints import components

        xyz = np.zeros((1, 3)) if assembly.nodes is None else assembly.nodes.xyz
        size = float(np.linalg.norm(np.ptp(xyz, axis=0)))
        own_motions, joints_of_points = components(_joint(name, joint), placed, size)
        joints += joints_of_points
        motions |= own_motions
    assembly = assembly.with_motions(motions)
    for name, sum_of in model.motions.items():
        try:
            assembly = assembly.with_motions({name: _weights(name, sum_of, assembly)})
        except UsageError as error:
            raise UsageError(error.problem, remedy=error.remedy, names=(f"motions.{name}",)) from error
    scene.raise_faults(dof_faults(model, assembly.dof_names))
    return assembly.joined(joints)


def _weights(name: str, sum_of: Mapping[Any, Any], structure: StructuralModel) -> Motion:
    """Return the weights of a motion by the DOFs' own labels."""
    if structure.dof_names.has(name, signed=True):
        raise UsageError(f"'{name}' is a DOF or motion already", remedy="Give the motion another name.")
    weights: dict[Label, float] = {}
    for dof, weight in sum_of.items():
        label = structure.label(dof)
        if label in weights:
            problem = f"the motion '{name}' names the DOF {label} twice"
            raise UsageError(problem, remedy="Write it once, with the sum of its weights.")
        weights[label] = float(weight)
    if not any(weights.values()):
        raise UsageError(f"the motion '{name}' has no weight but zero", remedy="Give weights.")
    return weights


def _bare(scene: Scene, model: IdentificationScene) -> StructuralModel:
    """Return the structure, or the assembly of the parts, without points and joints."""
    if model.structures is None:
        assert model.structure is not None
        parameters = with_units(all_parameters(scene.model), [model.structure], model.joints)
        return bare_structure(scene.folder, model.structure, parameters, "structure")
    from dynid.structure.assembly import assembled_parts

    parameters = with_units(all_parameters(scene.model), [*model.structures.values()], model.joints)
    parts = {
        name: bare_structure(scene.folder, structure, parameters, f"structures.{name}")
        for name, structure in model.structures.items()
    }
    return assembled_parts(parts, parameters)


def _point(name: str, point: PointModel, model: IdentificationScene, nodes: Nodes | None) -> Point:
    """Return a point with its nodes by their names in the assembly."""
    from dynid.structure.assembly import part_name
    from dynid.structure.points import Point

    path = f"points.{name}"
    if model.structures is None and point.part is not None:
        raise UsageError(
            f"the point '{name}' is of the part '{point.part}', but the scene has a single structure",
            remedy="Leave 'part' out.",
            names=(f"{path}.part",),
        )
    if model.structures is not None and point.part not in model.structures:
        said = "needs the 'part' that it is of"
        if point.part is not None:
            hint = did_you_mean(point.part, model.structures)
            said = f"is of a part '{point.part}' that does not exist{hint}"
        listed = ", ".join(model.structures)
        names = (f"{path}.part", path)
        raise UsageError(f"the point '{name}' {said}", remedy=f"Parts: {listed}.", names=names)

    def named(node: Any) -> Any:
        return node if point.part is None else part_name(point.part, node)

    if point.set is not None:
        sets = {} if nodes is None else nodes.sets
        if named(point.set) not in sets:
            set_names = [key.removeprefix(named("")) for key in sets if key.startswith(named(""))]
            raise UsageError(
                f"the point '{name}' names a set '{point.set}' that does not exist"
                f"{did_you_mean(point.set, set_names)}",
                remedy=f"There are {', '.join(set_names)}."
                if set_names
                else "There are none; name `nodes: [...]`.",
                names=(f"{path}.set",),
            )
        members = sets[named(point.set)]
    else:
        numbers: list[Any] = point.nodes or [point.node]
        members = tuple(named(node) for node in numbers)
    at = None if point.at is None else _vector(point.at)
    weights = tuple(float(weight) for weight in point.weights or ())
    return Point(name, members, point.spread, at, weights)


def _joint(name: str, joint: JointModel) -> Any:
    from dynid.structure.point_joints import PointJoint

    try:
        k, c, m, eta = (joint_parameter(value) for value in (joint.k, joint.c, joint.m, joint.eta))
    except UsageError as error:
        raise UsageError(error.problem, remedy=error.remedy, names=(f"joints.{name}",)) from None
    axes = None if joint.axes is None else _axes(name, joint.axes)
    at = None if joint.at is None else _vector(joint.at)
    components = [*dict.fromkeys(law.component for law in joint.laws)]
    laws = {along: joint_laws(name, joint, along) for along in components}
    return PointJoint(
        name, tuple(joint.points or ()), k, c, m, axes, at, eta, laws, joint_offset(joint) if laws else None
    )


def _axes(name: str, axes: Axes | AxesModel) -> Array:
    """Return the directions of a frame as rows; of named ones y is made orthogonal to x."""
    if isinstance(axes, list):
        return np.array([_vector(row) for row in axes])
    x, y = _direction(axes.x), _direction(axes.y)
    z = np.cross(x, y)
    if not np.linalg.norm(z) > 1e-9:
        problem = f"the axes x and y of joint {name} are parallel"
        raise UsageError(problem, remedy="Give others.", names=(f"joints.{name}.axes",))
    z /= np.linalg.norm(z)
    if axes.z is not None and not _direction(axes.z) @ z > 1 - 1e-6:
        raise UsageError(
            f"the axis z of joint {name} is not orthogonal to x and y, or points the other way",
            remedy="Leave it out: it is their cross product.",
            names=(f"joints.{name}.axes",),
        )
    rows = np.array([x, np.cross(z, x), z])
    return np.asarray(rows / np.linalg.norm(rows, axis=1)[:, None])


def _direction(components: Any) -> Array:
    """Return a unit vector of components of any size, or zeros."""
    vector = np.array(_vector(components))
    vector /= np.abs(vector).max() or 1.0
    return np.asarray(vector / (np.linalg.norm(vector) or 1.0))


def _vector(components: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in components)
    return x, y, z
