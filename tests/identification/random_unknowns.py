"""Random structures with unknowns of any kind identified from poor starts, and where the search ends.

    python -m tests.identification.random_unknowns FIRST LAST [WORKERS]

runs the seeds FIRST … LAST - 1 and prints a line each and a summary. Beams with unknown EI, rhoA, mass and
joints; chains with unknown masses, links and damping; frames with unknown EA, EI, rhoA. Starts are off by
factors of 0.3 to 3. At the optimum: the misfit is within 0.01 of that of a fit from the true values, or less.
"""

import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.arrays import guarded
from dynid.errors import Diverged, DynidError
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Chirp, Impact, Multisine
from dynid.parameters import Parameter, coordinates, starts, truths
from dynid.structure.assembly import PointMass, Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import Member, beam, frame
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load

QUANTITIES = ("displacement", "velocity", "acceleration")
KINDS = ("beam", "chain", "frame")
FIRST, LAST = 0.3, 3.0
# The misfit above the least that is the optimum; the deviation of a logarithm beyond which it has none.
_AT, _VAGUE = 0.01, 0.5


class Case(NamedTuple):
    """A random identification: the structure for starts off by given factors, its loads and measurement."""

    about: str
    structure: object
    factors: dict
    loads: list
    measurement: Measurement


def _unknown(true, factors):
    """Return unknown parameters and the numbers that they are, by name."""
    parameters = [Parameter(name, factors.get(name, 1.0) * value, value) for name, value in true.items()]
    return parameters, {name: Dependent.parameter(name, value) for name, value in true.items()}


def _beam(rng):
    length, elements = rng.uniform(2, 8), int(rng.integers(4, 8))
    EI, rhoA = 10 ** rng.uniform(2, 4), 10 ** rng.uniform(-1, 1)
    stiffness = EI / length**3
    true = {"EI": EI, "rhoA": rhoA, "m": rhoA * length * rng.uniform(0.1, 1)}
    own = {
        "a.k": EI / length * 10 ** rng.uniform(-0.5, 1),
        "b.k": stiffness * 10 ** rng.uniform(0.5, 2),
        "b.c": math.sqrt(stiffness * rhoA * length) * 10 ** rng.uniform(-1.5, -0.5),
    }

    def structure(factors):
        parameters, value = _unknown(true, factors)
        part = {name: JointParameter(start=factors.get(name, 1) * own[name], true=own[name]) for name in own}
        joints = [Joint("a", ("theta_1",), part["a.k"]), Joint("b", ("w_4",), part["b.k"], part["b.c"])]
        return beam(
            elements, length, value["EI"], value["rhoA"], supports=[Support(1, ("w",))],
            masses=[PointMass(3, value["m"])], damping=ProportionalDamping(0.1, 1e-4), joints=joints,
            parameters=parameters,
        )  # fmt: skip

    return structure, [*true, *own]


def _chain(rng):
    n = int(rng.integers(3, 6))
    k = (10 ** rng.uniform(3.3, 4.5, n)).tolist()
    masses = rng.uniform(0.5, 2, n).tolist()
    c = [one * 10 ** rng.uniform(-3.3, -2.7) for one in k]
    places = rng.permutation(n)
    true = {f"m{i}": masses[i] for i in places[: int(rng.integers(1, 3))]}
    true |= {f"k{i}": k[i] for i in rng.permutation(n)[: int(rng.integers(1, 3))]}
    true |= {f"c{i}": c[i] for i in rng.permutation(n)[:1]}

    def structure(factors):
        parameters, value = _unknown(true, factors)
        links = [
            Link((i + 1,) if i == 0 else (i, i + 1), value.get(f"k{i}", k[i]), value.get(f"c{i}", c[i]))
            for i in range(n)
        ]
        return lumped([value.get(f"m{i}", masses[i]) for i in range(n)], links, parameters=parameters)

    return structure, list(true)


def _frame(rng):
    height, width, elements = rng.uniform(2, 4), rng.uniform(2, 5), int(rng.integers(1, 3))
    EA, EI, rhoA = 10 ** rng.uniform(6, 7), 10 ** rng.uniform(3.5, 4.5), 10 ** rng.uniform(0.5, 1.2)
    true = {"EI": EI, "rhoA": rhoA, "alpha": rng.uniform(0.3, 2), "beta": 10 ** rng.uniform(-4.5, -3.5)}
    true |= {"EIb": EI * rng.uniform(0.5, 2)} if rng.random() < 0.6 else {}

    def structure(factors):
        parameters, value = _unknown(true, factors)
        column = [EA, value["EI"], value["rhoA"], elements]
        girder = [EA, value.get("EIb", value["EI"]), value["rhoA"], elements]
        members = [Member((1, 2), *column), Member((2, 3), *girder), Member((3, 4), *column)]
        return frame(
            [(0.0, 0.0), (0.0, height), (width, height), (width, 0.0)], members,
            supports=[Support(1, ("u", "w", "theta")), Support(4, ("u", "w", "theta"))],
            damping=ProportionalDamping(value["alpha"], value["beta"]), parameters=parameters,
        )  # fmt: skip

    return structure, list(true)


def case(seed):
    """Return the random case of a seed."""
    rng = np.random.default_rng([2027, seed])
    kind = KINDS[seed % len(KINDS)]
    structure, names = {"beam": _beam, "chain": _chain, "frame": _frame}[kind](rng)
    model = structure({})
    moving = [dof for dof in model.dofs if not str(dof).startswith("theta")]
    if kind == "frame":
        moving = ["u_2", "w_2", "u_3"]
    M, _, K = model.dense(model.true_values())
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    omega = np.sort(omega)[: int(rng.integers(3, 5))]
    step = 2 * math.pi / omega[-1] / rng.uniform(5, 8)
    samples = int(rng.choice([400, 800]))
    signal = str(rng.choice(["multisine", "chirp", "impact"]))
    amplitude = 100.0
    made = {
        "multisine": lambda: Multisine(
            [amplitude] * 4,
            np.sort(np.exp(rng.uniform(np.log(0.7 * omega[0]), np.log(omega[-1]), 4))).tolist(),
        ),
        "chirp": lambda: Chirp(amplitude, 0.5 * omega[0], 1.1 * omega[-1], samples * step),
        "impact": lambda: Impact(amplitude, 2 * step),
    }[signal]()
    quantities = rng.choice(QUANTITIES, 2).tolist()
    channels = tuple(
        Channel(dof, quantity)
        for dof, quantity in zip(rng.permutation(np.array(moving, dtype=object))[:2], quantities, strict=True)
    )
    noise = float(rng.choice([0.01, 0.05]))
    factors = {name: FIRST * (LAST / FIRST) ** rng.random() for name in names}
    loads = [Load(moving[int(rng.integers(len(moving)))], made)]
    measurement = Measurement(step, samples, channels, Simulation(noise, seed))
    shown = "/".join(one[0] for one in quantities)
    about = f"{kind}, {len(names)} unknowns, {signal}, {shown}, noise {noise:g}, {samples}"
    return Case(about, structure, factors, loads, measurement)


class Judgement(NamedTuple):
    """What came of a case: True at the optimum, how far the misfit is above it, seconds, and words."""

    seed: int
    at_optimum: bool
    above: float
    seconds: float
    words: str


def judged(seed):
    """Identify a random structure from its starts and from the truth, and compare."""
    this = case(seed)
    model = this.structure(this.factors)
    likelihood = Problem.of(model, [Experiment(this.loads, this.measurement)]).likelihood
    true = coordinates(likelihood.unknowns, truths(likelihood.unknowns))
    try:
        known = refine(likelihood, true, 100).fit
    except DynidError as error:
        return Judgement(seed, True, math.nan, 0.0, f"not counted: {type(error).__name__}")
    deviation = likelihood.information(known, known.noise).deviations().max()
    if deviation > _VAGUE:
        return Judgement(seed, True, math.nan, 0.0, f"not counted: a logarithm has deviation {deviation:.1f}")
    least = likelihood.misfit(known)
    begun = time.process_time()
    try:
        with guarded("the estimator", Diverged):
            found = Auto().run(likelihood, starts(likelihood.unknowns))
    except DynidError as error:
        seconds = time.process_time() - begun
        return Judgement(seed, False, math.inf, seconds, f"{type(error).__name__}: {error.problem[:90]}")
    seconds = time.process_time() - begun
    above = likelihood.misfit(found.fit) - least
    words = f"{'disputed, ' if found.disputed else ''}{len(found.stages)} stages, "
    words += next(stage.name for stage in found.stages if stage.eta is found.fit.eta)
    return Judgement(seed, above <= _AT, above, seconds, words)


def summary(judgements):
    """Return what came of cases, in lines."""
    counted = [each for each in judgements if not math.isnan(each.above)]
    seconds = np.array([each.seconds for each in counted])
    there = sum(each.at_optimum for each in counted)
    middle, high = np.quantile(seconds, [0.5, 0.9])
    return (
        f"{len(counted)} random structures: {there} at the optimum ({100 * there / len(counted):.1f} %)\n"
        f"  processor time: median {middle:.2f} s, p90 {high:.2f} s, most {seconds.max():.2f} s"
    )


if __name__ == "__main__":
    first, last, workers = (int(word) for word in (*sys.argv[1:], "1")[:3])
    with ProcessPoolExecutor(workers) as pool:
        judgements = []
        for each in pool.map(judged, range(first, last)):
            judgements.append(each)
            status = "optimum" if each.at_optimum else "ELSEWHERE"
            print(
                f"{each.seed:5d} {status:9s} {each.above:9.2g} {each.seconds:6.2f} s  "
                f"{case(each.seed).about}: {each.words}",
                flush=True,
            )
    print(summary(judgements))
