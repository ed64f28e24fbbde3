"""Frequency responses of structures: of a plate, and joints of a space frame identified from them.

That of a plate, small or large, is solved at each frequency, or by its modes. The space frame is taken as it
is, or reduced by hand first: three legs of 20 nodes with 114 DOFs are clamped at one end and joined by two
bolts, each of which turns about one axis, or about all three, on an unknown stiffness and damping. Four
accelerances have noise of 2 % of the response at each line; the unknowns start 50 % and 100 % off. Peers
have a basis made once at the starts: the modes below three times the highest line, and the static responses
to the force, the sensors and both joints. One gives the reduced model to dynid, the other minimises weighted
residuals by SciPy, with differences as derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import FEW_FREQUENCIES
from dynid.identification.identify import identify

#: Modes in the band, and most frequencies at which the error is evaluated.
_MODES, _PLACES = 10, 8


class _Plate(NamedTuple):
    """Mass, damping and stiffness, a force and an output (ports), and the highest frequency, rad/s."""

    M: Any
    C: Any
    K: Any
    ports: Any
    top: float


@lru_cache(maxsize=1)
def _plate(dofs: int) -> _Plate:
    from scipy.sparse import csc_array

    from dynid.bench.meshes import deflections, plate
    from dynid.structure.ports import Ports

    side = round((dofs / 3) ** 0.5)
    K, M = plate(side)
    places = deflections(side) - 1
    ends = np.zeros((2, K.shape[0]))
    ends[[0, 1], [places[len(places) // 3], places[len(places) // 2]]] = 1.0
    top = float(np.sqrt(_lowest(K, M)[0][-1]))
    return _Plate(M, csc_array(1e-5 * K + 0.1 * M), K, Ports(ends[:1].T, ends[1:], [0]), top)


def _lowest(K: Any, M: Any) -> Any:
    from scipy.sparse.linalg import LinearOperator, eigsh

    inverse = LinearOperator(K.shape, matvec=_factor(K).solve, dtype=float)
    return eigsh(K, _MODES, M, sigma=0.0, OPinv=inverse)


def _factor(matrix: Any) -> Any:
    """Factorise a symmetric matrix by SuperLU on its diagonal, half the time of its default."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    return splu(csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)


def _task(count: int, dofs: int) -> tuple[_Plate, Any]:
    """Return a plate and the frequencies of its responses."""
    return _plate(dofs), np.linspace(_plate(dofs).top / count, _plate(dofs).top, count)


def _places(count: int) -> Any:
    return np.unique(np.linspace(0, count - 1, _PLACES).astype(int))


def _by_method(task: tuple[_Plate, Any], method: str) -> Any:
    from dynid.structure.frf import frequency_response_functions

    (M, C, K, ports, _), omega = task
    return frequency_response_functions(M, C, K, ports, omega, method=method).response[:, 0, 0]


def _splu(task: tuple[_Plate, Any]) -> Any:
    """Solve at every frequency by SciPy, without checks of condition or residual."""
    (M, C, K, ports, _), omega = task
    force, row = ports.forces[:, 0].astype(complex), ports.rows[0]
    return np.array([row @ _factor(K + 1j * w * C - w**2 * M).solve(force) for w in omega])


def _superposed(task: tuple[_Plate, Any]) -> Any:
    """Superpose the modes of the band, without the others."""
    (M, C, K, ports, _), omega = task
    square, shapes = _lowest(K, M)
    damping = (shapes * (C @ shapes)).sum(axis=0)
    parts = (ports.rows @ shapes) * (shapes.T @ ports.forces).T
    return (parts / (square + 1j * omega[:, None] * damping - omega[:, None] ** 2)).sum(axis=1)


@lru_cache(maxsize=1)
def _true(count: int, dofs: int) -> Any:
    """Return the response at some frequencies, refined by residuals in extended precision."""
    (M, C, K, ports, _), omega = _task(count, dofs)
    wide, responses = [matrix.astype(np.longdouble) for matrix in (M, C, K)], []
    for w in omega[_places(count)].astype(np.longdouble):
        Z = [wide[2] - w**2 * wide[0], w * wide[1]]
        factor = _factor(Z[0].astype(float) + 1j * Z[1].astype(float))
        x = np.zeros(K.shape[0], dtype=np.clongdouble)
        for _ in range(4):
            product = Z[0] @ x.real - Z[1] @ x.imag + 1j * (Z[1] @ x.real + Z[0] @ x.imag)
            x += factor.solve((ports.forces[:, 0] - product).astype(complex))
        responses.append(ports.rows[0] @ x)
    return np.array(responses)


def _error(response: Any, count: int, dofs: int) -> float:
    true = _true(count, dofs)
    return float(np.max(np.abs(response[_places(count)] - true) / (np.abs(true) + np.median(np.abs(true)))))


def _responses(
    title: str, size: str, sizes: Any, full: Any, of: Callable[[int], tuple[int, int]]
) -> Benchmark:
    """Return a benchmark; `of` gives numbers of frequencies and of DOFs at a size."""
    return Benchmark(
        title=title,
        size=size,
        sizes=sizes,
        full=full,
        alternatives=(
            Alternative("modal", partial(_by_method, method="modal")),
            Alternative("direct", partial(_by_method, method="direct")),
            Alternative("splu", _splu, peer=True),
            Alternative("superposition", _superposed, peer=True),
        ),
        error=lambda size, response: _error(response, *of(size)),
        problem=lambda size: _task(*of(size)),
        measure="largest error, relative to the sum of the response and its median",
        default=lambda size: "modal" if of(size)[0] > FEW_FREQUENCIES.value else "direct",
        remark="modal responses are computed to 1e-8; splu checks neither condition nor residual",
    )


BENCHMARK = _responses(
    "Response of a plate of 1,000 DOFs at some frequencies of its first ten modes",
    "frequencies",
    (2, 6, 32),
    (4, 8, 128, 512),
    lambda count: (count, 1000),
)
LARGE = _responses(
    "Response of a plate at 20 frequencies of its first ten modes",
    "DOFs",
    (10_000,),
    (100_000,),
    lambda dofs: (20, dofs),
)


#: Stiffness and damping of the joints: true, and at the start.
TRUE = {"one": {"k": 2e4, "c": 3.0}, "two": {"k": 1e4, "c": 2.0}}
START = {"one": {"k": 1e4, "c": 1.5}, "two": {"k": 2e4, "c": 4.0}}
_NOISE, _TOP = 0.02, 400.0  # relative, Hz
_ALL = ("x", "y", "z", "rx", "ry", "rz")


_Axes = Mapping[str, Sequence[str]]
#: The axes about which the joints turn.
ONE_AXIS: _Axes = {"one": ("ry",), "two": ("rx",)}
_ALL_AXES: _Axes = dict.fromkeys(ONE_AXIS, _ALL[3:])


def unknowns(values: Mapping[str, Mapping[str, float]], axes: _Axes) -> dict[str, float]:
    """Return the values of the unknowns, starts or true ones, by name."""
    return {
        f"{name}_{axis}.{letter}": value
        for name in axes
        for axis in axes[name]
        for letter, value in values[name].items()
    }


def frame(axes: _Axes = ONE_AXIS) -> Any:
    """Return the frame, with joints that turn about some axes on unknown stiffness and damping."""
    from dynid.structure.assembly import Support
    from dynid.structure.damping import ProportionalDamping
    from dynid.structure.joints import Joint, JointParameter
    from dynid.structure.space_frame import SpaceMember, space_frame

    corners = [(0, 0, 0), (0, 0, 1.0), (0, 0, 1.0), (0.8, 0, 1.0), (0.8, 0, 1.0), (0.8, 0.7, 0.8)]
    section = 4.2e7, 3.15e3, 1.4e3, 1.7e3, 1.62  # EA, EIy, EIz, GJ, rhoA
    members = [
        SpaceMember((first, first + 1), *section, elements=count) for first, count in ((1, 6), (3, 5), (5, 6))
    ]
    joints = []
    for name, ends in (("one", (2, 3)), ("two", (4, 5))):
        for direction in _ALL:
            dofs = (f"{ends[0]}:{direction}", f"{ends[1]}:{direction}")
            if direction in axes[name]:
                k, c = (JointParameter(start=START[name][letter], true=TRUE[name][letter]) for letter in "kc")
                joints.append(Joint(f"{name}_{direction}", dofs, k, c))
            else:
                stiff = JointParameter(value=1e6 if direction.startswith("r") else 1e8)
                joints.append(Joint(f"{name}-{direction}", dofs, stiff))
    damping = ProportionalDamping(2.0, 1e-5)
    return space_frame(corners, members, supports=[Support(1, _ALL)], damping=damping, joints=joints)


class _Case(NamedTuple):
    """The frame, its measured responses, and the unknowns at their starts."""

    model: Any
    measurement: Any
    starts: dict[str, float]


@lru_cache(maxsize=1)
def measured_frame(lines: int, several_axes: bool = False) -> _Case:
    """Return the frame and its frequency responses, simulated with the whole frame."""
    from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
    from dynid.identification.systems.frf_system import FrfSystem
    from dynid.structure.ports import Channel

    axes = _ALL_AXES if several_axes else ONE_AXIS
    model = frame(axes)
    functions = tuple(Frf(Channel(dof, "acceleration"), "6:z") for dof in ("2:x", "4:y", "5:z", "6:z"))
    omega = 2 * np.pi * np.linspace(5, _TOP, lines)
    clean = FrfSystem.of(model, functions).response(omega).values
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((2, *clean.shape)) / np.sqrt(2)
    values = clean * (1 + _NOISE * (noise[0] + 1j * noise[1]))
    return _Case(model, FrfMeasurement(omega, functions, values, proportional=True), unknowns(START, axes))


def _reduced(case: _Case) -> Any:
    """Return the frame on its modes at the starts, and static responses to force, sensors and joints."""
    model, measurement, starts = case
    M, _, K = model.dense(starts)
    inverse = np.linalg.inv(np.linalg.cholesky(M))
    square, shapes = np.linalg.eigh(inverse @ K @ inverse.T)
    modes = inverse.T @ shapes[:, square < (3 * measurement.omega[-1]) ** 2]
    dofs = {dof for frf in measurement.channels for dof in (frf.channel.dof, frf.force)}
    dofs |= {dof for joint in model.joints if "-" not in joint.name for dof in joint.dofs}
    statics = np.linalg.solve(K, np.array([model.row(dof) for dof in sorted(dofs)]).T)
    columns = np.concatenate([modes, statics], axis=1)
    basis, sizes, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    basis = basis[:, sizes > 1e-10]
    return model.projected(basis, [f"q{k}" for k in range(basis.shape[1])])


def _identified(case: _Case, reduced_first: bool) -> Any:
    model = _reduced(case) if reduced_first else case.model
    return identify(model, case.measurement)["identification/parameters/estimate"].data


def _by_scipy(case: _Case) -> Any:
    """Reduce by hand, and minimise residuals over the measured magnitudes by SciPy."""
    from scipy.optimize import least_squares

    _, measurement, starts = case
    functions, s = measurement.channels, 1j * measurement.omega[:, None, None]
    small = _reduced(case)
    force = small.row(functions[0].force)
    rows = np.array([small.row(frf.channel.dof) for frf in functions])

    def residuals(logarithms: Any) -> Any:
        M, C, K = small.dense(dict(zip(starts, np.exp(logarithms), strict=True)))
        motion = np.linalg.solve(K + s * C + s**2 * M, force.astype(complex)[:, None])
        off = (s**2 * (rows @ motion))[:, :, 0] / measurement.source - 1
        return np.concatenate([off.real.ravel(), off.imag.ravel()])

    return np.exp(least_squares(residuals, np.log(list(starts.values())), method="lm").x)


def _joints_error(_: int, estimates: Any, axes: _Axes) -> float:
    return float(np.max(np.abs(np.asarray(estimates) / list(unknowns(TRUE, axes).values()) - 1)))


def _joints(several_axes: bool, sizes: tuple[int, ...], full: tuple[int, ...]) -> Benchmark:
    axes = _ALL_AXES if several_axes else ONE_AXIS
    return Benchmark(
        title=f"Joints of a space frame of 114 DOFs, with {len(unknowns(TRUE, axes))} unknowns, "
        "from its frequency responses at some lines",
        size="lines",
        sizes=sizes,
        full=full,
        alternatives=(
            Alternative("whole", partial(_identified, reduced_first=False)),
            Alternative("reduced-first", partial(_identified, reduced_first=True), peer=True),
            Alternative("least-squares-on-modes", _by_scipy, peer=True),
        ),
        error=partial(_joints_error, axes=axes),
        problem=partial(measured_frame, several_axes=several_axes),
        measure="largest relative error of an estimate",
        default=lambda _: "whole",
        remark="2 % noise; error bars and tests of the residuals by dynid alone",
    )


JOINTS = _joints(several_axes=False, sizes=(200, 791), full=(3000,))
MANY_JOINTS = _joints(several_axes=True, sizes=(200,), full=(800,))
