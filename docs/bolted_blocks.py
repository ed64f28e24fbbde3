"""Identify a bolt between two meshed blocks from many noisy tests: `python docs/bolted_blocks.py [SEEDS]`.

Writes docs/bolted_blocks.md. Every test is a record of 60 accelerations with 5 % noise and a modal survey
with scatter, made with parts of 50 fixed-interface modes each.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from dynid.errors import DynidError
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify, posterior_of
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.records.modal_measurement import ModalMeasurement, Scatter
from dynid.identification.results.write_result import add_identification
from dynid.identification.systems.record_values import data
from dynid.lti.waveforms import Multisine
from dynid.result import Selection
from dynid.structure.assembly import assembled_parts
from dynid.structure.damping import ProportionalDamping
from dynid.structure.joints import JointParameter
from dynid.structure.labels import DIRECTIONS
from dynid.structure.model import StructuralModel
from dynid.structure.point_joints import PointJoint, components
from dynid.structure.points import Point, with_points
from dynid.structure.ports import Channel, Load
from dynid.structure.reduction.methods import PartReduction, ReductionByParts
from dynid.structure.reduction.mode_selection import Interest, ModeRange
from dynid.structure.reduction.serep import JointAware
from dynid.structure.solid import Material, SetSupport, solid
from dynid.structure.solid_mesh import Block, SolidMesh

HERE = Path(__file__).parent
#: True stiffness, N/m and N m/rad, and damping, N s/m and N m s/rad, of the bolt.
TRUE = {
    "k": {"x": 6e7, "y": 5e7, "z": 1.5e8, "rx": 6e4, "ry": 4e4, "rz": 3e4},
    "c": {"x": 400, "y": 300, "z": 900, "rx": 0.6, "ry": 0.4, "rz": 3.0},
}
STARTS = (0.5, 2, 0.6, 1.7, 0.5, 1.8)
STEEL = Material(2.1e11, 0.3, 7850)
BOLT = np.array([0.345, 0.10, 0.03])
#: Half width of the washer, m.
WASHER = 0.0251
ENDS = tuple(f"{point}:{along}" for point in "pq" for along in DIRECTIONS)
STEP, SAMPLES, SETTLE, NOISE, SURVEYED = 1 / 2500, 150, 0.3, 0.05, 8
#: Relative scatter of the surveyed frequencies, damping ratios and shapes.
SCATTER = Scatter(0.002, 0.05, 0.05)
PARAMETERS = tuple(f"identification/parameters/{name}" for name in ("name", "estimate", "standard_error"))
#: Half width of a 95 % interval in standard errors.
WIDE = 1.959963984540054
CELLS = {"ten thousand": ((20, 10, 3), (24, 4, 3)), "a hundred thousand": ((54, 26, 6), (60, 9, 6))}
_CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
_EDGES = [(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)]
_EDGES += [(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]


def block(
    origin: tuple[float, ...], size: tuple[float, ...], cells: tuple[int, ...], *, clamped: bool
) -> StructuralModel:
    """Return a block of quadratic hexahedra, clamped where x = 0 or free."""
    counts = 2 * np.array(cells) + 1
    first = 2 * np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), -1).reshape(-1, 1, 3)
    grid = np.ravel_multi_index(tuple(np.moveaxis(first + np.array(_CORNERS + _EDGES), -1, 0)), counts)
    used, places = np.unique(grid, return_inverse=True)
    xyz = origin + np.stack(np.unravel_index(used, counts), -1) * np.array(size) / (counts - 1)
    mesh = SolidMesh(
        tuple(range(1, len(used) + 1)), xyz, (Block("hexahedron20", places.reshape(grid.shape)),),
        sets={"root": np.flatnonzero(xyz[:, 0] == 0)},
    )  # fmt: skip
    supports = [SetSupport("root", ("x", "y", "z"))] if clamped else []
    return solid(mesh, STEEL, supports=supports, damping=ProportionalDamping(4.0, 2e-6))


def assembly(cells: tuple[tuple[int, ...], ...]) -> StructuralModel:
    """Return a clamped plate and an arm that a bolt holds on it, its twelve parameters unknown."""
    parts = {
        "base": block((0, 0, 0), (0.40, 0.20, 0.03), cells[0], clamped=True),
        "arm": block((0.30, 0.07, 0.03), (0.45, 0.06, 0.03), cells[1], clamped=False),
    }
    below = {name: np.abs(part.nodes.xyz - BOLT) <= (WASHER, WASHER, 1e-9) for name, part in parts.items()}
    model, placed = with_points(
        assembled_parts(parts),
        [
            Point(point, tuple(f"{name}.{k + 1}" for k in np.flatnonzero(near.all(axis=1))), at=tuple(BOLT))
            for point, (name, near) in zip("pq", below.items(), strict=True)
        ],
    )
    unknown = {
        letter: {
            along: JointParameter(start=factor * value, true=value)
            for (along, value), factor in zip(values.items(), STARTS, strict=True)
        }
        for letter, values in TRUE.items()
    }
    motions, joints = components(PointJoint("bolt", ("p", "q"), unknown["k"], unknown["c"]), placed, 1.0)
    return model.with_motions(motions).joined(joints)


def by_parts(model: StructuralModel) -> StructuralModel:
    """Return an assembly with each part reduced by itself, its interface the bolt."""
    part = PartReduction("craig-bampton", {"modes": ModeRange(count=50)})
    return ReductionByParts({"base": part, "arm": part}, Interest(ENDS)).reduce(model).model


def nearest(model: StructuralModel, part: str, place: tuple[float, ...]) -> str:
    """Return the node of a part that is nearest to a place."""
    nodes = model.nodes
    own = [k for k, node in enumerate(nodes.numbers) if str(node).startswith(f"{part}.")]
    return str(nodes.numbers[min(own, key=lambda k: float(np.linalg.norm(nodes.xyz[k] - place)))])


@dataclass(frozen=True)
class Laboratory:
    """What all tests have in common: models, sensors, loads, and the values without noise.

    Parameters
    ----------
    truth
        The model that the tests are made with.
    model
        The model of the estimator.
    sensors
        Labels of the DOFs of the sensors.
    loads
        The loads of the record.
    record
        The record without noise (samples x sensors).
    modes
        Frequencies, rad/s, damping ratios, and shapes at the sensors.
    """

    truth: StructuralModel
    model: StructuralModel
    sensors: tuple[str, ...]
    loads: tuple[Load, ...]
    record: np.ndarray
    modes: tuple[np.ndarray, np.ndarray, np.ndarray]

    @classmethod
    def of(cls, truth: StructuralModel, *, in_plane: bool) -> Laboratory:
        """Return the laboratory; `in_plane`: it loads and measures the plane of symmetry only."""
        width = ((0.1,), (0.1,)) if in_plane else ((0.0, 0.2), (0.07, 0.13))
        places = [("base", (x, y, 0.03)) for x in (0.1, 0.2, 0.25, 0.3, 0.385) for y in width[0]]
        places += [("arm", (x, y, 0.06)) for x in (0.31, 0.4, 0.5, 0.6, 0.74) for y in width[1]]
        along = "xz" if in_plane else "xyz"
        sensors = tuple(f"{nearest(truth, *place)}:{one}" for place in places for one in along)
        ends = [f"{nearest(truth, 'arm', (0.75, width[1][0], 0.06))}:{one}" for one in along]
        ends += [f"{nearest(truth, 'base', (0.4, width[0][-1], 0.03))}:{one}" for one in "xz"]
        lines = 2 * np.pi * np.linspace(30, 900, 12 * len(ends))
        phases = np.random.default_rng(7).uniform(0, 2 * np.pi, (len(ends), 12))
        loads = tuple(
            Load(
                end, Multisine(amplitude=np.full(12, 20.0), frequency=lines[k :: len(ends)], phase=phases[k])
            )
            for k, end in enumerate(ends)
        )
        known = truth.true_values()
        model = JointAware(modes=ModeRange(count=16), residuals=ENDS).at(known).reduce(truth).model
        clean = Experiment(loads, _measurement(sensors, Simulation(settle=SETTLE)))
        return cls(truth, model, sensors, loads, data(truth, *clean).values, _modes(truth, sensors))

    def test(self, seed: int) -> tuple[ModalMeasurement, Experiment]:
        """Return the modal survey and the record of one seed."""
        rng = np.random.default_rng(seed)
        noise = NOISE * np.sqrt((self.record**2).mean(axis=0))
        record = self.record + noise * rng.standard_normal(self.record.shape)
        omega, zeta, shapes = self.modes
        spread = SCATTER.frequency * omega, SCATTER.damping * zeta, np.full(shapes.shape, SCATTER.shape)
        found = [
            one + std * rng.standard_normal(one.shape) for one, std in zip(self.modes, spread, strict=True)
        ]
        survey = ModalMeasurement(
            found[0], self.sensors, found[2], found[1], *spread, model_error=Scatter(0, 0, 0)
        )
        return survey, Experiment(self.loads, _measurement(self.sensors, record))

    def errors(self, seed: int) -> dict[str, tuple[float, float]]:
        """Return by parameter the error of its logarithm in standard errors, and its standard error."""
        survey, experiment = self.test(seed)
        posterior, _ = posterior_of(Problem.of(self.model, [experiment, survey]), OutputError())
        result = add_identification(Selection("identification", PARAMETERS), posterior)
        true = self.truth.true_values()
        return {
            str(name): (float(np.log(value / true[name]) * value / error), float(error / value))
            for name, value, error in zip(*(result[path].data for path in PARAMETERS), strict=True)
        }


def _measurement(sensors: tuple[str, ...], source: Simulation | np.ndarray) -> Measurement:
    channels = tuple(Channel(sensor, "acceleration") for sensor in sensors)
    start = 0.0 if isinstance(source, Simulation) else SETTLE
    return Measurement(STEP, SAMPLES, channels, source, start=start)


def _modes(model: StructuralModel, sensors: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return frequencies, damping ratios and shapes of the lowest modes, by the states' eigenvalues."""
    M, C, K = model.dense(model.true_values())
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    poles, vectors = np.linalg.eig(A)
    kept = [k for k in np.argsort(np.abs(poles)) if poles[k].imag > 0][:SURVEYED]
    shapes = np.array([model.row(sensor) for sensor in sensors]) @ vectors[:n, kept]
    largest = shapes[np.argmax(np.abs(shapes), axis=0), range(SURVEYED)]
    return np.abs(poles[kept]), -poles[kept].real / np.abs(poles[kept]), (shapes / largest).real


def sizes(name: str) -> tuple[StructuralModel, str]:
    """Return the reduced model of a mesh, and the row of the table of its time and memory."""
    began = time.process_time()
    full = assembly(CELLS[name])
    built = time.process_time()
    small = by_parts(full)
    reduced = time.process_time()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    row = (
        f"| {full.size:,} | {built - began:.1f} s | {reduced - built:.1f} s | {small.size} | {peak:.2f} GB |"
    )
    return small, row


def coverage(laboratory: Laboratory, seeds: int) -> Iterator[str]:
    """Yield the lines on the tests of all seeds."""
    began, runs, refused = time.process_time(), [], []
    for seed in range(1, seeds + 1):
        try:
            runs.append(laboratory.errors(seed))
        except DynidError as error:
            refused.append(error.problem)
    names = list(runs[0])
    found = np.array([[run[name] for name in names] for run in runs])
    held = np.abs(found[:, :, 0]) <= WIDE
    seconds = (time.process_time() - began) / seeds
    yield f"{seeds} tests · {len(refused)} refused · {seconds:.1f} s of processor time each"
    yield ""
    yield "| parameter | standard error | coverage | RMS error / standard error | bias / standard error |"
    yield "|---|---|---|---|---|"
    for k, name in enumerate(names):
        error, size = found[:, k].T
        yield (
            f"| {name} | {100 * np.median(size):.2g} % | {100 * held[:, k].mean():.1f} % "
            f"| {np.sqrt((error**2).mean()):.2f} | {error.mean():+.2f} |"
        )
    wide = np.sqrt(0.05 * 0.95 / held.size)
    rms = np.sqrt((found[..., 0] ** 2).mean())
    yield f"| all | | {100 * held.mean():.1f} ± {100 * wide:.1f} % | {rms:.2f} | |"


def undetermined(truth: StructuralModel) -> str:
    """Return what an identification says that loads and measures the plane of symmetry only."""
    laboratory = Laboratory.of(truth, in_plane=True)
    result = identify(laboratory.model, [laboratory.test(1)[1]])
    return str(result["identification/diagnostics/warnings"].data[0])


HEADER = """\
# A bolt between two meshed blocks

Written by `python docs/bolted_blocks.py {seeds}`. A plate of steel, 400 x 200 x 30 mm, is clamped along
one edge; an arm, 450 x 60 x 30 mm, is bolted to it. Both are meshed with quadratic hexahedra; the bolt
acts between the nodes below its washer (distributed points) by six stiffnesses and six dampings, all
unknown. Each test is a record of {samples} samples of 60 accelerations under five forces with
{noise:.0f} % noise, and a modal survey: {modes} frequencies, damping ratios and shapes at the same
sensors with 0.2, 5 and 5 % scatter. Tests are made with parts of 50 fixed-interface modes each; the
estimator works with 16 modes of the whole and residual vectors at the bolt, and starts at half to twice
the true values.
"""


def main(seeds: int) -> None:
    """Write the page."""
    small, row = sizes("ten thousand")
    tests = list(coverage(Laboratory.of(small, in_plane=False), seeds))
    said = undetermined(small)
    rows = [row, sizes("a hundred thousand")[1]]
    text = "\n".join(
        [
            HEADER.format(seeds=seeds, samples=SAMPLES, noise=100 * NOISE, modes=SURVEYED),
            "## Coverage of the 95 % intervals\n",
            *tests,
            "\n## What is not identifiable\n",
            "From a record of forces and accelerations in the plane of symmetry alone:",
            f"\n> {said}\n",
            "## Time and memory\n",
            "Processor time of the assembly of the meshes and of the reduction of the parts; peak memory.\n",
            "| DOFs | assembly | reduction | coordinates | memory |",
            "|---|---|---|---|---|",
            *rows,
        ]
    )
    (HERE / "bolted_blocks.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
