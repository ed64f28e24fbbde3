"""Records that are hard to identify joints from: noisy, clean, sparse, stiff, light; and hopeless ones.

Records are simulated by dynid from true values, or solved here: steady motions under sines.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import partial
from typing import Any

import numpy as np

from tests.hard.case import Case, Refusal
from tests.hard.scenes import NO_FILES, Files, run

TRUE = "the true values"
WITHIN = 4.0  # standard errors at the Cramér–Rao bound; 1 of 16,000 normal numbers is beyond
LINES = (70.0, 110.0, 250.0)
SUSPENSION: dict[str, Any] = {
    "dynid": 1,
    "kind": "identification",
    "structure": {
        "lumped": {
            "masses": [2, 2, 1.5, 1, 1],
            "links": [
                {"dofs": [1], "k": 2e4, "c": 20},
                {"dofs": [1, 2], "k": 3e4, "c": 30},
                {"dofs": [4, 5], "k": 2e4, "c": 20},
            ],
        }
    },
    "joints": {
        "upper": {"dofs": [2, 3], "k": {"start": 1e4, "true": 2e4}, "c": {"start": 10, "true": 20}},
        "lower": {"dofs": [3, 4], "k": {"start": 1e4, "true": 2e4}, "c": {"start": 10, "true": 20}},
    },
    "excitation": [{"dof": 5, "kind": "multisine", "amplitude": [100] * 3, "frequency": [*LINES]}],
    "measurement": {
        "step": 0.002,
        "samples": 800,
        "channels": [{"dof": 2, "quantity": "velocity"}, {"dof": 3, "quantity": "velocity"}],
        "simulate": {"noise_ratio": 0.05, "seed": 1, "settle": 10},
    },
    "derived": [],  # no case is about modes or zeros of the estimate
}


def suspension(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the suspension of Yang with values at dotted paths changed; None takes a key away."""
    scene = deepcopy(SUSPENSION)
    for path, value in changes.items():
        *holders, last = path.split(".")
        part = scene
        for key in holders:
            part = part[key]
        part[last] = value
        if value is None:
            del part[last]
    return scene


def one_mass(mass: float, k: float, c: float, step: float, samples: int, **simulate: Any) -> dict[str, Any]:
    """Return a mass on a joint, driven near its resonance and at half of it."""
    omega = float(np.sqrt(k / mass))
    force = 0.01 * k
    return {
        "dynid": 1,
        "kind": "identification",
        "structure": {"lumped": {"masses": [mass]}},
        "joints": {
            "joint": {"dofs": [1], "k": {"start": 0.7 * k, "true": k}, "c": {"start": 0.5 * c, "true": c}}
        },
        "excitation": [
            {"dof": 1, "kind": "multisine", "amplitude": [force] * 2, "frequency": [0.9 * omega, 0.5 * omega]}
        ],
        "measurement": {
            "step": step,
            "samples": samples,
            "channels": [{"dof": 1, "quantity": "velocity"}],
            "simulate": {"noise_ratio": 0.05, "seed": 1, **simulate},
        },
        "derived": [],
    }


def _column(result: Any, name: str) -> np.ndarray:
    return np.asarray(result.value(f"identification/parameters/{name}"))


def in_bounds(scene: Mapping[str, Any], files: Files = NO_FILES, undetermined: str = "") -> float:
    """Return the largest error of an estimate over its Cramér–Rao bound; one may be undetermined."""
    result = run(scene, files)
    assert result.value("identification/diagnostics/converged") == (not undetermined)
    identifiable = _column(result, "name") != undetermined
    assert np.array_equal(_column(result, "identifiable"), identifiable)
    off = _column(result, "estimate") - _column(result, "true")
    return float(np.abs(off / _column(result, "cramer_rao"))[identifiable].max())


def estimates(scene: Mapping[str, Any], files: Files = NO_FILES) -> np.ndarray:
    """Return the estimates over the true values."""
    result = run(scene, files)
    return _column(result, "estimate") / _column(result, "true")


def noisy(
    name: str,
    scene: Mapping[str, Any],
    files: Files = NO_FILES,
    *,
    undetermined: str = "",
    slow: bool = False,
) -> Case:
    """Return a case whose error is in units of the Cramér–Rao bound; one parameter may be undetermined."""
    ask = partial(in_bounds, scene, files, undetermined)
    return Case(f"{name}, errors in Cramér–Rao bounds", "identification", TRUE, ask, None, WITHIN, slow=slow)


def clean(
    name: str, scene: Mapping[str, Any], parameters: int, bound: float, files: Files = NO_FILES
) -> Case:
    """Return a case without noise: the true values themselves."""
    return Case(name, "identification", TRUE, partial(estimates, scene, files), np.ones(parameters), bound)


def refused(
    name: str, scene: Mapping[str, Any], says: str, files: Files = NO_FILES, *, slow: bool = False
) -> Case:
    """Return a case that has no answer."""
    source = "by hand: the record does not determine it"
    return Case(name, "identification", source, partial(run, scene, files), Refusal(says), slow=slow)


# --- records that dynid did not make -------------------------------------------------------------


def steady(samples: int, step: float) -> np.ndarray:
    """Return the steady velocities of DOFs 2 and 3, solved in complex numbers (samples x 2)."""
    M, C, K = np.diag([2, 2, 1.5, 1, 1]), np.zeros((5, 5)), np.zeros((5, 5))
    links = [((0,), 2e4, 20), ((0, 1), 3e4, 30), ((1, 2), 2e4, 20), ((2, 3), 2e4, 20), ((3, 4), 2e4, 20)]
    for dofs, k, c in links:
        row = np.zeros(5)
        row[list(dofs)] = [1, -1][: len(dofs)]
        K += k * np.outer(row, row)
        C += c * np.outer(row, row)
    t = step * np.arange(samples)
    y = np.zeros((samples, 2))
    for omega in LINES:
        x = np.linalg.solve(K + 1j * omega * C - omega**2 * M, 100 * np.eye(5)[4])
        y += np.imag(1j * omega * x[1:3] * np.exp(1j * omega * t)[:, None])
    return y


def measured(y: np.ndarray, noise: float = 0.0) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the suspension's scene for a record in a file, and the file."""
    size = np.sqrt(np.nansum(y**2, axis=0) / len(y))
    y = y + noise * size * np.random.default_rng(5).standard_normal(y.shape)
    lines = [",".join("" if np.isnan(value) else repr(float(value)) for value in row) for row in y]
    scene = suspension({
        "measurement.simulate": None,
        "measurement.samples": len(y),
        "measurement.file": {"path": "record.csv"},
    })  # fmt: skip
    return scene, {"record.csv": "\n".join(["a,b", *lines, ""])}


def _from_file(
    name: str, y: np.ndarray, noise: float = 0.0, bound: float = 1e-6, *, slow: bool = False
) -> Case:
    scene, files = measured(y, noise)
    true = np.array([2e4, 20, 2e4, 20])

    def ask() -> Any:
        result = run(scene, files)
        estimate = _column(result, "estimate")
        order = {"upper.k": 0, "upper.c": 1, "lower.k": 2, "lower.c": 3}
        known = true[[order[str(each)] for each in _column(result, "name")]]
        if noise:
            return np.abs((estimate - known) / _column(result, "standard_error")).max()
        return estimate / known

    if noise:
        return Case(
            f"{name}, errors in standard errors", "identification", TRUE, ask, None, WITHIN, slow=slow
        )
    return Case(name, "identification", TRUE, ask, np.ones(4), bound, slow=slow)


def _files() -> list[Case]:
    whole = steady(800, 0.002)
    blocks, sparse = whole.copy(), whole.copy()
    blocks[100:300] = blocks[500:700, 0] = np.nan
    sparse[np.random.default_rng(2).random(whole.shape) < 0.8] = np.nan
    dead = whole.copy()
    dead[:, 1] = np.nan
    clipped = np.clip(whole, -0.4 * np.abs(whole).max(axis=0), 0.4 * np.abs(whole).max(axis=0))

    return [
        _from_file("a clean steady record", whole),
        _from_file("blocks of 200 samples missing", blocks),
        _from_file("blocks of 200 samples missing, 5 % noise", blocks, 0.05, slow=True),
        _from_file("four of five samples missing", sparse),
        _from_file("four of five samples missing, 5 % noise", sparse, 0.05),
        refused("a dead sensor", *_swapped(measured(dead), r"3\.velocity")),
        refused("a record in µm/s taken for m/s", *_swapped(measured(whole * 1e6), "are invalid"), slow=True),
        _rejected("noise instead of a record", np.random.default_rng(0).standard_normal((800, 2))),
        *(_noise_on_one_line(seed) for seed in (1, 2)),
        _uncontradicted("one sine in one channel", 150.0),
        _uncontradicted("one sine in one channel, a sample late", 150.0, -0.3),
        refused(
            "a record clipped at 40 % of its peaks", *_swapped(measured(clipped), "are invalid"), slow=True
        ),
    ]  # fmt: skip


def _rejected(name: str, y: np.ndarray) -> Case:
    """Return a case whose record bears no model out: it is answered, and the answer is called rejected."""
    scene, files = measured(y)

    def verdicts() -> list[str]:
        result = run(scene, files)
        each = ("converged", "explained")
        return [str(result.value(f"identification/diagnostics/{verdict}")) for verdict in each]

    return Case(f"{name} is rejected", "identification", "by hand", verdicts, ["False", "False"])


def _pair(omega: float, phase: float = 0.0) -> tuple[dict[str, Any], dict[str, str]]:
    """Return two masses joined by an unknown bolt, one sine and one channel, and the record's file.

    The record is solved here with 5 % noise; the force that it belongs to leads the scene's by `phase`.
    """
    step, samples, k, c = 0.002, 900, 2e4, 3.0
    K = np.array([[1.5e4 + k, -k], [-k, k]])
    C = np.array([[4 + c, -c], [-c, c]])
    x = np.linalg.solve(K + 1j * omega * C - omega**2 * np.diag([1.2, 0.8]), [20, 0])
    y = np.imag(-(omega**2) * x[1] * np.exp(1j * (omega * step * np.arange(samples) + phase)))
    y += 0.05 * np.sqrt(np.mean(y**2)) * np.random.default_rng(3).standard_normal(samples)
    scene = {
        "dynid": 1,
        "kind": "identification",
        "structure": {"lumped": {"masses": [1.2, 0.8], "links": [{"dofs": [1], "k": 1.5e4, "c": 4}]}},
        "joints": {"bolt": {"dofs": [1, 2], "k": {"start": 1.2e4}, "c": {"start": 1.8}}},
        "excitation": [{"dof": 1, "kind": "sine", "amplitude": 20, "frequency": omega}],
        "measurement": {
            "step": step,
            "samples": samples,
            "channels": [{"dof": 2, "quantity": "acceleration"}],
            "file": {"path": "record.csv"},
        },
        "derived": [],
    }
    return scene, {"record.csv": "\n".join(["a", *map(repr, y.tolist()), ""])}


def _uncontradicted(name: str, omega: float, phase: float = 0.0) -> Case:
    """Return a case whose record fits any such model: two numbers of one line, two unknowns."""
    scene, files = _pair(omega, phase)

    def verdicts() -> list[str]:
        result = run(scene, files)
        return [
            str(result.value(f"identification/diagnostics/{verdict}"))
            for verdict in ("converged", "redundancy")
        ]

    return Case(f"{name} is not converged", "identification", "by hand: 2 numbers", verdicts, ["False", "0"])


def _noise_on_one_line(seed: int) -> Case:
    """Return a case of noise alone in one channel, for a scene with one sine."""
    scene, _ = _pair(150.0)
    y = np.random.default_rng(seed).standard_normal(900)
    files = {"record.csv": "\n".join(["a", *map(repr, y.tolist()), ""])}
    name = f"noise (seed {seed}) for a response to one sine is rejected"

    def verdicts() -> list[str]:
        result = run(scene, files)
        return [
            str(result.value(f"identification/diagnostics/{verdict}"))
            for verdict in ("converged", "explained")
        ]

    return Case(name, "identification", "by hand", verdicts, ["False", "False"], slow=seed > 1)


def _swapped(given: tuple[Any, Files], says: str) -> tuple[Any, str, Files]:
    return given[0], says, given[1]


def _stepping(turn: float, noise: float) -> Case:
    """A stiff link turns by so many radians a step: nothing is integrated, so nothing limits the step."""
    top = 4 * (turn / 0.002) ** 2 / 4
    links: list[dict[str, Any]] = deepcopy(SUSPENSION["structure"]["lumped"]["links"])
    links[1]["k"] = top
    scene = suspension({"structure.lumped.links": links, "measurement.simulate.noise_ratio": noise})
    name = f"a link that turns by {turn:g} rad a step"
    return noisy(f"{name}, 5 % noise", scene) if noise else clean(name, scene, 4, 1e-5)


def _scaled(size: float) -> dict[str, Any]:
    """Return the suspension with stiffness, damping, mass and force times a number."""
    joint = {
        "k": {"start": 1e4 * size, "true": 2e4 * size},
        "c": {"start": 10 * size, "true": 20 * size},
    }
    links: list[dict[str, Any]] = deepcopy(SUSPENSION["structure"]["lumped"]["links"])
    for link in links:
        link["k"] *= size
        link["c"] *= size
    return suspension({
        "structure.lumped.masses": [size * mass for mass in SUSPENSION["structure"]["lumped"]["masses"]],
        "structure.lumped.links": links,
        "joints.upper": {"dofs": [2, 3], **joint},
        "joints.lower": {"dofs": [3, 4], **joint},
        "excitation": [{"dof": 5, "kind": "multisine", "amplitude": [100 * size] * 3, "frequency": [*LINES]}],
    })  # fmt: skip


def _started(factors: Sequence[float]) -> dict[str, Any]:
    up_k, up_c, low_k, low_c = factors
    return suspension({
        "joints.upper.k.start": 2e4 * up_k,
        "joints.upper.c.start": 20 * up_c,
        "joints.lower.k.start": 2e4 * low_k,
        "joints.lower.c.start": 20 * low_c,
    })  # fmt: skip


def _cases() -> list[Case]:
    undamped = {
        "structure.lumped.links": [
            {"dofs": [1], "k": 2e4},
            {"dofs": [1, 2], "k": 3e4},
            {"dofs": [4, 5], "k": 2e4},
        ]
    }
    springs = {
        "joints.upper": {"dofs": [2, 3], "k": {"start": 1e4, "true": 2e4}},
        "joints.lower": {"dofs": [3, 4], "k": {"start": 1e4, "true": 2e4}},
        "measurement.simulate.settle": 0,
    }
    twins = {
        "upper": {"dofs": [2, 3], "k": {"start": 1e4, "true": 2e4}, "c": 20},
        "twin": {"dofs": [2, 3], "k": {"start": 1e4, "true": 1e4}},
        "lower": {"dofs": [3, 4], "k": 2e4, "c": 20},
    }
    ratio = "measurement.simulate.noise_ratio"
    return [
        *(noisy(f"{noise:.1%} noise", suspension({ratio: noise})) for noise in (0.001, 0.5)),
        clean("no noise at all", suspension({ratio: 0}), 4, 1e-6),
        *(noisy(f"stiffness of {2e4 * size:g} N/m", _scaled(size)) for size in (5e-8, 5e4)),
        noisy("damping ratio of 1e-5", one_mass(1.0, 1e4, 2e-3, 0.01, 2000)),
        noisy("damping ratio of 1e-5, from rest for 3 periods", one_mass(1.0, 1e4, 2e-3, 0.001, 200)),
        noisy("damping ratio of 10", one_mass(1.0, 1e4, 2e3, 0.001, 800)),
        noisy(
            "a spring, undetermined beside a damping ratio of 1000",
            one_mass(1.0, 1e4, 2e5, 0.01, 800),
            undetermined="joint.k",
        ),
        noisy("stiffness of 1e-3 N/m on 1e-9 kg", one_mass(1e-9, 1e-3, 1e-7, 1e-4, 800)),
        noisy("stiffness of 1e9 N/m on 1e4 kg", one_mass(1e4, 1e9, 1e5, 1e-3, 800)),
        *(_stepping(turn, 0.0) for turn in (0.01, 0.1, 3.0, 30.0)),
        *(_stepping(turn, 0.05) for turn in (3.0, 30.0)),
        noisy("no damping at all", suspension({**undamped, **springs})),
        clean("no damping and no noise at all", suspension({**undamped, **springs, ratio: 0}), 2, 1e-6),
        noisy("started at 0.01, 100, 30 and 0.05 times the truth", _started((0.01, 100, 30, 0.05))),
        noisy("started at a tenth of the truth", _started((0.1, 0.1, 0.1, 0.1))),
        *_files(),
        refused(
            "two joints between the same masses", suspension({"joints": twins}), "cannot be distinguished"
        ),
        refused("one sample", suspension({"measurement.samples": 1}), "fewer values than unknowns"),
        refused(
            "a force of zero, at rest",
            suspension({
                "excitation": [{"dof": 5, "kind": "sine", "amplitude": 0, "frequency": 70}],
                "measurement.simulate": {"noise": 0.01, "seed": 1},
            }),
            ".",
        ),
        noisy("a million samples", suspension({"measurement.samples": 1_000_000}), slow=True),
    ]  # fmt: skip


CASES = _cases()
