"""Factors of random partitions of a frame, given as matrices in parts, from records of both kinds."""

import numpy as np
import pytest
from scipy.sparse import csr_array, save_npz

from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from dynid.structure.assembly import Support
from dynid.structure.frame import Member, frame

pytestmark = pytest.mark.thorough

CORNERS = [(0.0, 0.0), (0.0, 3.0), (0.0, 6.0), (4.0, 6.0), (4.0, 3.0), (4.0, 0.0)]
ENDS = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (2, 5)]
FIXED = ("u", "w", "theta")
EA, EI, RHO_A = 2e6, 4e4, 8.0


def whole(stiff, heavy):
    """Return mass and stiffness of a frame of two storeys whose members have these factors."""
    members = [Member(ends, EA * s, EI * s, RHO_A * m) for ends, s, m in zip(ENDS, stiff, heavy, strict=True)]
    made = frame(CORNERS, members, supports=[Support(1, FIXED), Support(6, FIXED)])
    return np.array(made.M), np.array(made.K)


def of_members(letter, members):
    """Return the matrix of some of the members: the change where they count twice."""
    twice = np.ones(len(ENDS))
    twice[members] = 2
    ones = np.ones(len(ENDS))
    place = "MK".index(letter)
    more = whole(ones, twice) if letter == "M" else whole(twice, ones)
    return more[place] - whole(ones, ones)[place]


def partitions(rng, letter, folder):
    """Write a random partition into parts, all but the first with an unknown factor.

    Returns the list of the scene, the factors, and the matrix at their true values.
    """
    count = int(rng.integers(2, 5))
    group = np.concatenate([np.arange(count), rng.integers(0, count, len(ENDS) - count)])
    rng.shuffle(group)
    parts, factors, total = [], {}, 0.0
    for k in range(count):
        matrix = of_members(letter, np.flatnonzero(group == k))
        save_npz(folder / f"{letter}{k}.npz", csr_array(np.where(np.abs(matrix) > 1e-6, matrix, 0)))
        name, true = f"{letter.lower()}{k}", float(rng.uniform(0.6, 1.6)) if k else 1.0
        total = total + true * matrix
        parts.append(f"{{path: {letter}{k}.npz, factor: {name}}}" if k else f"{{path: {letter}{k}.npz}}")
        if k:
            factors[name] = true
    return f"[{', '.join(parts)}]", factors, total


def scene_of(folder, seed, kind):
    """Write the scene of a random partition, starts off by factors of 0.5 to 2; return the true factors."""
    rng = np.random.default_rng([18, seed])
    stiffness, true, K = partitions(rng, "K", folder)
    mass, more, M = (
        partitions(rng, "M", folder) if seed % 3 == 1 else ("M.npz", {}, of_members("M", range(6)))
    )
    true |= more
    save_npz(folder / "M.npz", csr_array(M))
    save_npz(folder / "C.npz", csr_array(0.5 * M + 2e-4 * K))
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    omega = np.sort(omega)[:6]
    starts = ", ".join(
        f"{name}: {{start: {value * 2 ** rng.uniform(-1, 1)!r}, true: {value!r}}}"
        for name, value in true.items()
    )
    sensors = [1, 5, 8]  # u_2, w_3 and w_4
    if kind == "frf":
        channels = ", ".join(f"{{dof: {d}, quantity: acceleration, reference: {{dof: 4}}}}" for d in sensors)
        record = f"""
  frf: {{simulate: {{lines: {{start: {0.5 * omega[0]}, stop: {1.1 * omega[-1]}, points: 120}},
         noise_ratio: 0.01, seed: {seed + 1}}}}}"""
        excitation = ""
    else:
        channels = ", ".join(f"{{dof: {d}, quantity: velocity}}" for d in sensors)
        frequency = ", ".join(str(f) for f in np.outer(omega, (0.93, 1.05)).ravel())
        record = f"""
  step: {1.2 / omega[-1]}
  samples: 500
  simulate: {{noise_ratio: 0.01, seed: {seed + 1}}}"""
        amplitude = ", ".join(["100"] * 12)
        signal = f"kind: multisine, amplitude: [{amplitude}], frequency: [{frequency}]"
        excitation = f"excitation: [{{dof: 4, {signal}}}]"
    (folder / "frame.yaml").write_text(f"""
dynid: 1
kind: identification
parameters: {{{starts}}}
structure: {{matrices: {{mass: {mass}, stiffness: {stiffness}, damping: C.npz}}}}
{excitation}
measurement:
  channels: [{channels}]{record}
derived: []
""")
    return true


def assert_recovered(folder, seed, kind):
    true = scene_of(folder, seed, kind)
    result = run_scene(load_scene(folder / "frame.yaml"))
    group = "identification/parameters"
    assert list(result.value(f"{group}/name")) == list(true)
    estimate, bound, error = (
        np.asarray(result.value(f"{group}/{name}")) for name in ("estimate", "cramer_rao", "standard_error")
    )
    off = (estimate - list(true.values())) / bound
    assert np.all(np.abs(off) < 4.5), (seed, kind, off)
    assert result.value("identification/diagnostics/converged"), (seed, kind)
    np.testing.assert_allclose(error, bound, rtol=0.25)  # of the residuals, hundreds of them
    return off


def test_parts_add_up_to_the_frame():
    ones = np.ones(len(ENDS))
    for letter, matrix in zip("MK", whole(ones, ones), strict=True):
        total = of_members(letter, [0, 3]) + of_members(letter, [1, 2, 4, 5])
        np.testing.assert_allclose(total, matrix, rtol=0, atol=1e-12 * np.abs(matrix).max())


@pytest.mark.parametrize(("seed", "kind"), [(0, "record"), (1, "frf")])
def test_factors_of_a_partition_are_recovered(tmp_path, seed, kind):
    assert_recovered(tmp_path, seed, kind)


@pytest.mark.slow
def test_factors_of_twenty_partitions_are_recovered(tmp_path):
    """`pytest -m slow tests/scene/test_partitioned_frames.py`."""
    off = []
    for seed in range(20):
        for kind in ("frf", "record"):
            folder = tmp_path / f"{kind}{seed}"
            folder.mkdir()
            off.append(assert_recovered(folder, seed, kind))
    every = np.concatenate(off)
    assert abs(np.sqrt(np.mean(every**2)) - 1) < 3.5 / np.sqrt(2 * len(every))
