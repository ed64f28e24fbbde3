"""Frequency responses of structures: of a plate, and joints of a space frame identified from them.

That of a plate is solved at each frequency, or by its modes. The space frame is taken as it is, or reduced by
hand first: three legs of 20 nodes with 114 DOFs are clamped at one end and joined by two bolts, each of which
turns on an unknown stiffness and damping. Four accelerances have noise of 2 % of the response at each line;
the unknowns start 50 % and 100 % off. Peers have a basis made once at the starts: the modes below three times
the highest line, and the static responses to the force, the sensors and both joints. One gives the reduced
model to dynid, the other minimises weighted residuals by SciPy, with differences as derivatives.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.defaults import FEW_FREQUENCIES
from dynid.identification.identify import identify

#: Approximate number of DOFs, modes in the band, and most frequencies at which the error is evaluated.
_DOFS, _MODES, _PLACES = 1000, 10, 8


class _Plate(NamedTuple):
    """Mass, damping and stiffness, a force and an output (ports), and the highest frequency, rad/s."""

    M: Any
    C: Any
    K: Any
    ports: Any
    top: float


@lru_cache(maxsize=1)
def _plate() -> _Plate:
    from scipy.sparse import csc_array

    from dynid.bench.meshes import deflections, plate
    from dynid.structure.ports import Ports

    side = round((_DOFS / 3) ** 0.5)
    K, M = plate(side)
    places = deflections(side) - 1
    ends = np.zeros((2, K.shape[0]))
    ends[[0, 1], [places[len(places) // 3], places[len(places) // 2]]] = 1.0
    top = float(np.sqrt(_lowest(K, M)[0][-1]))
    return _Plate(M, csc_array(1e-5 * K + 0.1 * M), K, Ports(ends[:1].T, ends[1:], [0]), top)


def _lowest(K: Any, M: Any) -> Any:
    from scipy.sparse.linalg import eigsh

    return eigsh(K, _MODES, M, sigma=0.0)


def _frequencies(count: int) -> Any:
    return np.linspace(_plate().top / count, _plate().top, count)


def _places(count: int) -> Any:
    return np.unique(np.linspace(0, count - 1, _PLACES).astype(int))


def _by_method(omega: Any, method: str) -> Any:
    from dynid.structure.frf import frequency_response_functions

    M, C, K, ports, _ = _plate()
    return frequency_response_functions(M, C, K, ports, omega, method=method).response[:, 0, 0]


def _spsolve(omega: Any) -> Any:
    """Solve at every frequency by SciPy, without checks of condition or residual."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import spsolve

    M, C, K, ports, _ = _plate()
    force, row = ports.forces[:, 0].astype(complex), ports.rows[0]
    return np.array([row @ spsolve(csc_array(K + 1j * w * C - w**2 * M), force) for w in omega])


def _superposed(omega: Any) -> Any:
    """Superpose the modes of the band, without the others."""
    M, C, K, ports, _ = _plate()
    square, shapes = _lowest(K, M)
    damping = (shapes * (C @ shapes)).sum(axis=0)
    parts = (ports.rows @ shapes) * (shapes.T @ ports.forces).T
    return (parts / (square + 1j * omega[:, None] * damping - omega[:, None] ** 2)).sum(axis=1)


@lru_cache(maxsize=1)
def _true(count: int) -> Any:
    """Return the response at some frequencies, refined by residuals in extended precision."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    M, C, K, ports, _ = _plate()
    wide, responses = [matrix.astype(np.longdouble) for matrix in (M, C, K)], []
    for w in _frequencies(count)[_places(count)].astype(np.longdouble):
        Z = [wide[2] - w**2 * wide[0], w * wide[1]]
        factor = splu(csc_array(Z[0].astype(float) + 1j * Z[1].astype(float)))
        x = np.zeros(K.shape[0], dtype=np.clongdouble)
        for _ in range(4):
            product = Z[0] @ x.real - Z[1] @ x.imag + 1j * (Z[1] @ x.real + Z[0] @ x.imag)
            x += factor.solve((ports.forces[:, 0] - product).astype(complex))
        responses.append(ports.rows[0] @ x)
    return np.array(responses)


def _error(count: int, response: Any) -> float:
    true = _true(count)
    return float(np.max(np.abs(response[_places(count)] - true) / (np.abs(true) + np.median(np.abs(true)))))


BENCHMARK = Benchmark(
    title="Response of a plate of 1,000 DOFs at some frequencies of its first ten modes",
    size="frequencies",
    sizes=(2, 6, 32),
    full=(4, 8, 128, 512),
    alternatives=(
        Alternative("modal", partial(_by_method, method="modal")),
        Alternative("direct", partial(_by_method, method="direct")),
        Alternative("spsolve", _spsolve, peer=True),
        Alternative("superposition", _superposed, peer=True),
    ),
    error=_error,
    problem=_frequencies,
    measure="largest error, relative to the sum of the response and its median",
    default=lambda count: "modal" if count > FEW_FREQUENCIES.value else "direct",
    remark="modal responses are computed to 1e-8; spsolve checks neither condition nor residual",
)


_TRUE = {"one.k": 2e4, "one.c": 3.0, "two.k": 1e4, "two.c": 2.0}
_START = {"one.k": 1e4, "one.c": 1.5, "two.k": 2e4, "two.c": 4.0}
_NOISE, _TOP = 0.02, 400.0  # relative, Hz
_ALL = ("x", "y", "z", "rx", "ry", "rz")


def frame() -> Any:
    """Return the frame, with its joints."""
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
    for name, ends, free in (("one", (2, 3), "ry"), ("two", (4, 5), "rx")):
        for direction in _ALL:
            dofs = (f"{ends[0]}:{direction}", f"{ends[1]}:{direction}")
            if direction == free:
                k, c = (
                    JointParameter(start=_START[f"{name}.{letter}"], true=_TRUE[f"{name}.{letter}"])
                    for letter in "kc"
                )
                joints.append(Joint(name, dofs, k, c))
            else:
                stiff = JointParameter(value=1e6 if direction.startswith("r") else 1e8)
                joints.append(Joint(f"{name}-{direction}", dofs, stiff))
    damping = ProportionalDamping(2.0, 1e-5)
    return space_frame(corners, members, supports=[Support(1, _ALL)], damping=damping, joints=joints)


@lru_cache(maxsize=1)
def _case(lines: int) -> tuple[Any, Any]:
    """Return the frame and its frequency responses, simulated with the whole frame."""
    from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
    from dynid.identification.systems.frf_system import FrfSystem
    from dynid.structure.ports import Channel

    model = frame()
    functions = tuple(Frf(Channel(dof, "acceleration"), "6:z") for dof in ("2:x", "4:y", "5:z", "6:z"))
    omega = 2 * np.pi * np.linspace(5, _TOP, lines)
    clean = FrfSystem.of(model, functions).response(omega).values
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((2, *clean.shape)) / np.sqrt(2)
    values = clean * (1 + _NOISE * (noise[0] + 1j * noise[1]))
    return model, FrfMeasurement(omega, functions, values, proportional=True)


def _reduced(model: Any, measurement: Any) -> Any:
    """Return the frame on its modes at the starts, and static responses to force, sensors and joints."""
    M, _, K = model.dense(_START)
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


def _identified(case: tuple[Any, Any], reduced_first: bool) -> Any:
    model, measurement = case
    model = _reduced(model, measurement) if reduced_first else model
    return identify(model, measurement)["identification/parameters/estimate"].data


def _by_scipy(case: tuple[Any, Any]) -> Any:
    """Reduce by hand, and minimise residuals over the measured magnitudes by SciPy."""
    from scipy.optimize import least_squares

    model, measurement = case
    functions, s = measurement.channels, 1j * measurement.omega[:, None, None]
    small = _reduced(model, measurement)
    force = small.row(functions[0].force)
    rows = np.array([small.row(frf.channel.dof) for frf in functions])

    def residuals(logarithms: Any) -> Any:
        M, C, K = small.dense(dict(zip(_START, np.exp(logarithms), strict=True)))
        motion = np.linalg.solve(K + s * C + s**2 * M, force.astype(complex)[:, None])
        off = (s**2 * (rows @ motion))[:, :, 0] / measurement.source - 1
        return np.concatenate([off.real.ravel(), off.imag.ravel()])

    return np.exp(least_squares(residuals, np.log(list(_START.values())), method="lm").x)


def _joints_error(_: int, estimates: Any) -> float:
    return float(np.max(np.abs(np.asarray(estimates) / list(_TRUE.values()) - 1)))


JOINTS = Benchmark(
    title="Joints of a space frame of 114 DOFs from its frequency responses at some lines",
    size="lines",
    sizes=(200, 791),
    full=(3000,),
    alternatives=(
        Alternative("whole", partial(_identified, reduced_first=False)),
        Alternative("reduced-first", partial(_identified, reduced_first=True), peer=True),
        Alternative("least-squares-on-modes", _by_scipy, peer=True),
    ),
    error=_joints_error,
    problem=_case,
    measure="largest relative error of an estimate",
    default=lambda _: "whole",
    remark="2 % noise; error bars and tests of the residuals by dynid alone",
)
