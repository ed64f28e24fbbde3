"""The structure of a scene, with its joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from dynid.arithmetic.dependent import Real
from dynid.errors import DynidError, Fault, FileError, UsageError
from dynid.number_format import frequency_text
from dynid.parameters import Parameter, ParameterPrior
from dynid.scene.kinds.parameters import all_parameters, quantities
from dynid.scene.schema.joints import JointModel, LawParameterModel, MassModel, ParameterModel
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.references import DOF, SIGNED_DOF, dof_faults, references
from dynid.scene.schema.structure import (
    BeamModel,
    DampingModel,
    FileModel,
    FrameModel,
    LumpedModel,
    MaterialModel,
    MatricesModel,
    SolidModel,
    SpaceFrameModel,
    StructureModel,
)
from dynid.structure.joints import Joint, JointLaw, JointParameter, unit_of
from dynid.structure.labels import kind
from dynid.suggestions import shortened
from dynid.units import angular_factor

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.load import Scene
    from dynid.structure.damping import ModalDamping, ProportionalDamping
    from dynid.structure.law import Law
    from dynid.structure.model import StructuralModel


def build_structure(
    scene: Scene,
    structure: StructureModel,
    joints: Mapping[str, JointModel],
    holder: BaseModel | None = None,
    at: tuple[str, ...] = (),
) -> StructuralModel:
    """Return the structure of a scene with its joints, which has every DOF that the scene names.

    `holder` is the section at the path `at` that names its DOFs; default: the scene. Raises `SceneError` if
    the scene names DOFs that the structure does not have. Raises `FileError` if a file of matrices cannot be
    read. Raises `UsageError` if the matrices are not those of a structure.
    """
    parameters = with_units(all_parameters(scene.model), [structure], joints)
    built = [dof_joint(name, joint) for name, joint in joints.items()]
    dotted_path = ".".join((*at, "structure"))
    bare = bare_structure(scene.folder, structure, parameters, dotted_path)
    if structure.labels() is None:  # found only now: the DOFs are those of a file, or depend on releases
        faults = dof_faults(holder or scene.model, bare.dof_names)
        scene.raise_faults(((*at, *path), message) for path, message in faults)
    with located(dotted_path, structure):
        return bare.joined(built)


def dof_joint(name: str, joint: JointModel) -> Joint:
    """Return a joint between DOFs.

    Raises `UsageError` if its numbers make no sense, or it is one between points.
    """
    if joint.points is not None:
        said = f"joint {name} is between points, which a structure has in an identification only"
        raise UsageError(said, remedy="Name DOFs.", names=(f"joints.{name}",))
    try:
        k, c, m, eta = (joint_parameter(value) for value in (joint.k, joint.c, joint.m, joint.eta))
        laws = joint_laws(name, joint) if joint.laws else ()
        offset = joint_offset(joint) if joint.laws else None
        return Joint(name, tuple(joint.dofs), k, c, m, eta, laws=laws, offset=offset)
    except UsageError as error:
        places = error.names or (f"joints.{name}",)
        raise UsageError(error.problem, remedy=error.remedy, names=places) from None


def joint_laws(name: str, joint: JointModel, component: str | None = None) -> tuple[JointLaw, ...]:
    """Return the nonlinear laws of a joint, of one between points those along a component.

    Raises `UsageError` if their values make no sense.
    """
    from dynid.arithmetic.expression import parse
    from dynid.structure.expression_law import ExpressionLaw
    from dynid.structure.joint_laws import LAWS
    from dynid.structure.model_laws import joint_law

    laws = []
    for index, model in enumerate(joint.laws):
        if model.component != component:
            continue
        try:
            if model.kind == "expression":
                law: Law = ExpressionLaw(parse(model.f.text), [*model.f.parameters])
                parameters = [
                    JointParameter(value.real, signed=True) for value in model.f.parameters.values()
                ]
            else:
                further = type(model).model_fields.keys() - {"kind", "component"}
                values = {key: getattr(model, key) for key in sorted(further)}
                numbers = {
                    key: value for key, value in values.items() if isinstance(value, LawParameterModel)
                }
                law = LAWS[model.kind](**{key: value for key, value in values.items() if key not in numbers})
                parameters = [_law_parameter(numbers[key], signed=key in law.signed) for key in law.names]
            laws.append(joint_law(law, parameters))
        except UsageError as error:
            raise UsageError(
                error.problem, remedy=error.remedy, names=(f"joints.{name}.laws.{index}",)
            ) from None
    return tuple(laws)


def joint_offset(joint: JointModel) -> JointParameter | None:
    """Return the offset of a joint, if it has one."""
    return None if joint.offset is None else _law_parameter(joint.offset, signed=True)


def _law_parameter(parameter: LawParameterModel, *, signed: bool) -> JointParameter:
    value = None if parameter.value is None else parameter.value.real
    keys = (parameter.start, parameter.true, parameter.min, parameter.max)
    start, true, low, high = (None if quantity is None else float(quantity) for quantity in keys)
    prior = None
    if parameter.prior is not None:
        prior = ParameterPrior(float(parameter.prior.value), float(parameter.prior.relative_deviation))
    return JointParameter(value, start, true, None, low, high, prior, signed)


def idle_masses(scene: Scene) -> Iterator[Fault]:
    """Yield the masses of a lumped structure that no other key of its scene names, as one warning."""
    structure: StructureModel | None = getattr(scene.model, "structure", None)
    if structure is None or structure.lumped is None:
        return
    model = scene.model
    occurrences = (item for to in (DOF, SIGNED_DOF) for item in references(type(model), model, to))
    named = {str(occurrence.value) for occurrence in occurrences}
    idle = [number for number in structure.lumped.labels() if str(number) not in named]
    if idle and len(structure.lumped.masses) > 1:
        which = f"masses {shortened(list(map(str, idle)))}" if len(idle) > 1 else f"mass {idle[0]}"
        message = f"{which} of {len(structure.lumped.masses)}: no link, joint, load or channel names "
        message += "a DOF of this number, so nothing connects it; add a link, or leave the mass out"
        path = ("structure", "lumped", "masses", int(idle[0]) - 1)
        yield scene.source.fault(path, message)


def bare_structure(
    folder: Path, structure: StructureModel, parameters: Sequence[Parameter], path: str
) -> StructuralModel:
    """Return a structure without joints; errors name the place of its part in the scene."""
    with located(path, structure):
        kind = structure.kind
        return _BUILDERS[kind](folder, getattr(structure, kind), parameters)


@contextmanager
def located(path: str, structure: StructureModel) -> Iterator[None]:
    """Add the place of the structure, or of the file, to the names of an error."""
    try:
        yield
    except DynidError as error:
        kind = structure.kind
        keys = type(getattr(structure, kind)).model_fields
        inside = [f"{path}.{kind}.{name}" for name in error.names if name.split(".")[0] in keys]
        error.names = (*inside[:1], *error.names, f"{path}.{kind}")
        raise


def number(quantity: Quantity | None) -> float:
    """Return a quantity as a number; absent, 0."""
    return 0.0 if quantity is None else float(quantity)


def _real(quantity: Quantity | None) -> Real:
    """Return a quantity as a number, which may depend on parameters; absent, 0."""
    return 0.0 if quantity is None else quantity.real


#: Units of quantities of structures by their keys; those of springs and dampers depend on their directions.
_UNITS = {
    "masses": "kg", "m": "kg", "J": "kg.m^2", "EA": "N", "EI": "N.m^2", "EIy": "N.m^2", "EIz": "N.m^2",
    "GJ": "N.m^2", "rhoA": "kg/m", "rhoJ": "kg.m", "E": "Pa", "rho": "kg/m^3", "length": "m",
    "alpha": "1/s", "beta": "s",
}  # fmt: skip


def with_units(
    parameters: Sequence[Parameter], structures: Sequence[StructureModel], joints: Mapping[str, JointModel]
) -> tuple[Parameter, ...]:
    """Return unknown parameters with the units of the quantities that they are, where these agree."""
    if not parameters:
        return ()
    units: dict[str, set[str]] = {}
    for quantity, unit in (*_of_structures(structures), *_of_joints(structures, joints)):
        if quantity is not None and quantity.dependent is not None and not quantity.dependent.operation:
            units.setdefault(quantity.dependent.operands[0], set()).add(unit)
    return tuple(
        replace(parameter, unit=next(iter(unit_names)))
        if len(unit_names := units.get(parameter.name, set())) == 1
        else parameter
        for parameter in parameters
    )


def _of_structures(structures: Sequence[StructureModel]) -> Iterator[tuple[Quantity | None, str]]:
    for structure in structures:
        yield from ((quantity, _UNITS[key]) for key, quantity in quantities(structure) if key in _UNITS)
        model = structure.beam or structure.frame or structure.space_frame
        springs = [(item, [kind(item.direction + "_1")]) for item in (model.springs if model else ())]
        links: list[Any] = structure.lumped.links if structure.lumped else []
        for item, kinds in (*springs, *((link, []) for link in links)):
            yield from ((item.k, unit_of("k", kinds)), (item.c, unit_of("c", kinds)))


def _of_joints(
    structures: Sequence[StructureModel], joints: Mapping[str, JointModel]
) -> Iterator[tuple[Quantity | None, str]]:
    labels: Sequence[int | str] = []  # as far as the scene states or determines them
    if len(structures) == 1:
        stated = structures[0].matrices.labels if structures[0].matrices else None
        labels = stated if isinstance(stated, list) else structures[0].labels() or []
    point_masses = all(structure.lumped for structure in structures)
    for joint in joints.values():
        ends = [
            labels[dof - 1] if isinstance(dof, int) and 1 <= dof <= len(labels) else dof for dof in joint.dofs
        ]
        kinds = ["translation"] * len(ends) if point_masses else [kind(end) for end in ends]
        for letter in "kcm":
            values: ParameterModel | MassModel | dict[str, ParameterModel] | None = getattr(joint, letter)
            if isinstance(values, dict):
                for along, value in values.items():
                    yield value.value, unit_of(letter, [kind(f"1:{along}")])
            elif values is not None and values.matrix is None:
                yield values.value, unit_of(letter, kinds)


def _lumped(_: Path, model: LumpedModel, parameters: Sequence[Parameter]) -> StructuralModel:
    from dynid.structure.lumped import Link, lumped

    links = [
        Link(tuple(int(dof) for dof in link.dofs), _real(link.k), _real(link.c), _real(link.eta))
        for link in model.links
    ]
    masses = [mass.real for mass in model.masses]
    return lumped(masses, links, parameters=parameters, damping=_damping(model.damping))


def _beam(_: Path, model: BeamModel, parameters: Sequence[Parameter]) -> StructuralModel:
    from dynid.structure.frame import beam

    return beam(
        model.elements,
        _each(model.length),
        _each(model.EI),
        _each(model.rhoA),
        **_attached(model),
        damping=_damping(model.damping),
        parameters=parameters,
        eta=0.0 if model.eta is None else _each(model.eta),
    )


def _frame(_: Path, model: FrameModel, parameters: Sequence[Parameter]) -> StructuralModel:
    from dynid.structure.frame import Member, frame

    members = [
        Member(
            (member.nodes[0], member.nodes[1]),
            member.EA.real,
            member.EI.real,
            member.rhoA.real,
            member.elements,
            tuple(member.hinges),
            _real(member.eta),
        )
        for member in model.members
    ]
    points = [(x.real, y.real) for x, y in model.nodes]
    return frame(points, members, **_attached(model), damping=_damping(model.damping), parameters=parameters)


def _space_frame(_: Path, model: SpaceFrameModel, parameters: Sequence[Parameter]) -> StructuralModel:
    from dynid.structure.assembly import Spring, Support
    from dynid.structure.space_frame import RigidMass, SpaceMember, space_frame

    members = [
        SpaceMember(
            (entry.nodes[0], entry.nodes[1]),
            *(entry.EA.real, entry.EIy.real, entry.EIz.real, entry.GJ.real, entry.rhoA.real),
            None if entry.rhoJ is None else entry.rhoJ.real,
            None if entry.orientation is None else _vector(entry.orientation),
            (_vector(entry.offsets[0]), _vector(entry.offsets[1])) if entry.offsets else (_NOWHERE, _NOWHERE),
            (tuple(entry.releases[0]), tuple(entry.releases[1])) if entry.releases else ((), ()),
            entry.elements,
            _real(entry.eta),
        )
        for entry in model.members
    ]
    return space_frame(
        [_vector(point) for point in model.nodes],
        members,
        supports=[Support(item.node, tuple(item.fix)) for item in model.supports],
        masses=[
            RigidMass(entry.node, _real(entry.m), _vector(entry.J), _vector(entry.offset))
            for entry in model.masses
        ],
        springs=[
            Spring(entry.node, entry.direction, *(_real(value) for value in (entry.k, entry.c, entry.eta)))
            for entry in model.springs
        ],
        damping=_damping(model.damping),
        parameters=parameters,
    )


def _solid(folder: Path, model: SolidModel, parameters: Sequence[Parameter]) -> StructuralModel:
    from dynid.files.read_mesh import read_mesh
    from dynid.structure.solid import Material, SetSupport, solid
    from dynid.units import si_factor

    def material(material_model: MaterialModel) -> Material:
        number = material_model
        return Material(number.E.real, float(number.nu), number.rho.real, _real(number.eta))

    materials = model.materials
    return solid(
        read_mesh(
            folder / model.mesh, si_factor(model.unit, ("m",)), [folder / path for path in model.includes]
        ),
        {name: material(item) for name, item in materials.items()}
        if isinstance(materials, dict)
        else material(materials),
        supports=[SetSupport(item.place, tuple(item.fix)) for item in model.supports],
        damping=_damping(model.damping),
        parameters=parameters,
    )


_NOWHERE = (0.0, 0.0, 0.0)


def _vector(components: Sequence[Quantity] | None) -> tuple[Real, Real, Real]:
    if components is None:
        return _NOWHERE
    x, y, z = components
    return x.real, y.real, z.real


def _attached(model: BeamModel | FrameModel) -> dict[str, Any]:
    from dynid.structure.assembly import PointMass, Spring, Support

    return {
        "supports": [Support(item.node, tuple(item.fix)) for item in model.supports],
        "masses": [PointMass(item.node, _real(item.m), _real(item.J)) for item in model.masses],
        "springs": [
            Spring(item.node, item.direction, *(_real(value) for value in (item.k, item.c, item.eta)))
            for item in model.springs
        ],
    }


def _matrices(folder: Path, model: MatricesModel, parameters: Sequence[Parameter]) -> StructuralModel:
    from dynid.files.read_matrix import matrix_file, read_labels
    from dynid.files.read_structure import MatrixPart, from_state_space, imported, model_files

    try:
        labels = read_labels(folder / model.labels) if isinstance(model.labels, str) else model.labels or ()
    except FileError as error:
        raise FileError(error.problem, remedy=error.remedy, names=("labels",)) from None
    if model.state_space is not None:
        state_space = model.state_space
        names = {role: name for role in "ABC" if (name := getattr(state_space, role)) is not None}
        return from_state_space(folder / state_space.path, names, labels=labels)

    def files(items: list[FileModel]) -> list[MatrixPart]:
        factors = [1.0 if item.factor is None else item.factor.real for item in items]
        matrices = (matrix_file(folder, item.path, item.name) for item in items)
        return list(map(MatrixPart, matrices, factors))

    nodes = None if model.nodes is None else folder / model.nodes
    damping = files(model.damping) if isinstance(model.damping, list) else _damping(model.damping)
    structural = files(model.structural or [])
    if model.model is not None:
        try:
            complete_model = model_files(folder / model.model)
            return imported(
                complete_model.mass,
                complete_model.stiffness,
                damping or complete_model.damping,
                labels=labels,
                parameters=parameters,
                nodes=nodes or complete_model.nodes,
                structural=structural or [MatrixPart(file) for file in complete_model.structural],
            )
        except (FileError, UsageError) as error:
            further_keys = {
                key for key in ("labels", "damping", "structural", "nodes") if getattr(model, key) is not None
            }
            if not further_keys & {*error.names}:
                error.names = ("model", *error.names)
            raise
    assert model.mass is not None
    assert model.stiffness is not None
    mass, stiffness = files(model.mass), files(model.stiffness)
    return imported(
        mass,
        stiffness,
        damping,
        labels=labels,
        parameters=parameters,
        nodes=nodes,
        structural=structural,
        gyroscopic=files(model.gyroscopic or []),
        circulatory=files(model.circulatory or []),
        speed=float(model.speed or 0.0),
    )


_BUILDERS: dict[str, Callable[[Path, Any, Sequence[Parameter]], StructuralModel]] = {
    "lumped": _lumped,
    "beam": _beam,
    "frame": _frame,
    "space_frame": _space_frame,
    "solid": _solid,
    "matrices": _matrices,
}


def add_doubts(result: Result, structure: StructuralModel) -> None:
    """Add the sentences on what contradicts the nodes of a structure, and on dampers that stand for eta."""
    if structure.viscous_at is not None:
        at = structure.viscous_at
        said = f"dampers eta k / omega of {frequency_text(at, 6)} stand for the structural damping"
        result.annotate("structure/damping", doubt=f"{said}: it is equal at that frequency alone")
    if structure.nodes is not None and structure.nodes.doubts:
        result.annotate("structure/nodes", doubt="; ".join(structure.nodes.doubts))


def _damping(damping: DampingModel | None) -> ProportionalDamping | ModalDamping | None:
    from dynid.structure.damping import ModalDamping, ProportionalDamping

    if damping is None:
        return None
    if damping.ratio is not None:
        return ModalDamping(_each(damping.ratio))
    at = damping.equivalent
    viscous_at = None if at is None else angular_factor(at.unit) * float(at.at)
    return ProportionalDamping(_real(damping.alpha), _real(damping.beta), _real(damping.eta), viscous_at)


def _each(quantity: Quantity | list[Quantity]) -> Real | list[Real]:
    return [value.real for value in quantity] if isinstance(quantity, list) else quantity.real


def joint_parameter(parameter: Any) -> Any:
    """Return k, c or m of a joint; of one between points by direction."""
    if isinstance(parameter, dict):
        return {along: _parameter(value) for along, value in parameter.items()}
    return _parameter(parameter)


def _parameter(parameter: ParameterModel | MassModel | None) -> JointParameter | None:
    if parameter is None:
        return None
    matrix = [[value.real for value in row] for row in parameter.matrix] if parameter.matrix else None
    value = None if parameter.value is None else parameter.value.real
    if not isinstance(parameter, ParameterModel):
        return JointParameter(value, matrix=matrix)
    keys = (parameter.start, parameter.true, parameter.min, parameter.max)
    start, true, low, high = (None if quantity is None else float(quantity) for quantity in keys)
    prior = None
    if parameter.prior is not None:
        prior = ParameterPrior(float(parameter.prior.value), float(parameter.prior.relative_deviation))
    return JointParameter(value, start, true, matrix, low, high, prior)
