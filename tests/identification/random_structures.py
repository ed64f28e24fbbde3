"""Random structures identified, and what came of them by an oracle (`maximum_likelihood`).

    python -m tests.identification.random_structures FIRST LAST [WORKERS]

runs the seeds FIRST … LAST - 1 and prints a line each and a summary. At the optimum: −2 log L, the noise of
each channel estimated, is within 0.01 of the least that any method finds (dynid; SciPy from where dynid
ended, from the truth and from random starts). Falsely converged: it is more than 10 above, and `converged`.
Refused: as a whole, or a parameter is marked as not identifiable.
"""

import math
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np

from dynid.errors import Diverged, NotIdentifiable
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement
from dynid.lti.signals import Impact, Multisine, Sampled
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.maximum_likelihood import Element, Force, Problem, Record

QUANTITIES = ("displacement", "velocity", "acceleration")
OPTIMUM, NEAR, LOCAL, FALSELY = "optimum", "near", "local optimum", "falsely converged"
RIGHTLY, WRONGLY = "refused rightly", "refused wrongly"
STATUSES = (OPTIMUM, NEAR, LOCAL, FALSELY, RIGHTLY, WRONGLY)
# −2 log L above the least that is the optimum, and that is none.
_AT, _FAR = 0.01, 10.0
# Random starts of the oracle; the bound on the deviation of a logarithm beyond which nothing is told; what
# −2 log L may rise by if the record hardly contradicts a value (five standard deviations).
_STARTS, _BLIND, _HARDLY = 2, 1.0, 25.0


class Case(NamedTuple):
    """A random identification; `start` and the unknowns of `problem` are in one order."""

    seed: int
    problem: Problem
    start: np.ndarray
    noise: float
    record: Record
    about: str


def case(seed):
    """Return the random case of a seed."""
    rng = np.random.default_rng([2026, seed])
    n = int(rng.integers(2, 9))
    masses = rng.uniform(0.3, 3.0, n)
    branched = rng.random() < 0.4
    ends = [(0,)] if rng.random() < 0.85 else []
    ends += [(int(rng.integers(k)) if branched else k - 1, k) for k in range(1, n)]
    if rng.random() < 0.3:
        ends.append((n - 1,))
    k = 10 ** rng.uniform(3.3, 4.5, len(ends))
    c = k * 10 ** rng.uniform(-3.5, -2.5, len(ends))
    elements = tuple(Element(*each) for each in zip(ends, k.tolist(), c.tolist(), strict=True))
    joints = sorted(rng.choice(len(ends), min(len(ends), int(rng.integers(1, 5))), replace=False).tolist())
    damped = rng.random() < 0.6
    unknowns = tuple(
        (joint, letter) for joint in joints for letter in ("kc" if damped and rng.random() < 0.7 else "k")
    )
    bare = Problem(masses, elements, unknowns, Force(0, "sines", np.ones(1), np.ones(1)), 1.0, 1, ((0, 0),))
    M, _, K = bare.matrices(bare.truth)
    omega = np.sqrt(np.maximum(np.linalg.eigvals(np.linalg.solve(M, K)).real, 0.0))
    low, high = omega[omega > 1e-3 * omega.max()].min(), omega.max()
    samples = int(rng.choice([400, 800, 1600]))
    step = 2 * np.pi / high / rng.uniform(3, 10)
    channels = {}
    while len(channels) < min(n, int(rng.integers(1, 4))):
        channels[int(rng.integers(n)), int(rng.integers(3))] = None
    kind = str(rng.choice(["sine", "multisine", "impact", "random"]))
    force = _force(rng, kind, int(rng.integers(n)), low, high, step, samples)
    problem = bare._replace(force=force, step=step, samples=samples, channels=tuple(channels))
    noise = float(rng.choice([0.0, 0.01, 0.05, 0.1, 0.2]))
    forced, _ = problem.response(problem.truth)
    values = forced + noise * np.sqrt(np.mean(forced**2, axis=0)) * rng.standard_normal(forced.shape)
    start = problem.truth + np.log(10) * rng.uniform(-1, 1, len(unknowns))
    about = (
        f"{n} masses, {len(unknowns)} unknowns, {kind}, {len(channels)} channels, noise {noise:g}, {samples}"
    )
    return Case(seed, problem, start, noise, Record(problem, values), about)


def _force(rng, kind, dof, low, high, step, samples):
    if kind in ("sine", "multisine"):
        count = 1 if kind == "sine" else int(rng.integers(2, 6))
        frequency = np.sort(np.exp(rng.uniform(np.log(0.7 * low), np.log(high), count)))
        return Force(dof, "sines", np.full(count, 100.0), frequency)
    if kind == "impact":
        return Force(dof, "impact", np.array(150.0), np.array(rng.uniform(1.5, 8) * step))
    return Force(dof, "samples", 100 * rng.standard_normal(samples), np.zeros(0))


def _joints(case):
    problem, start = case.problem, np.exp(case.start)
    named = {}
    for (k, letter), value in zip(problem.unknowns, start.tolist(), strict=True):
        true = getattr(problem.elements[k], letter)
        named.setdefault(k, {})[letter] = JointParameter(start=value, true=true)
    links, joints = [], []
    for k, element in enumerate(problem.elements):
        dofs = tuple(dof + 1 for dof in element.dofs)
        if k in named:
            parts = {"k": element.k, "c": element.c} | named[k]
            joints.append(Joint(f"j{k}", dofs, parts["k"], parts["c"]))
        else:
            links.append(Link(dofs, element.k, element.c))
    return links, joints


def suite(case, estimator=None):
    """Run dynid on a case: the result, and its names in the order of the problem."""
    problem, force = case.problem, case.problem.force
    links, joints = _joints(case)
    signal = {
        "sines": lambda: Multisine(force.first.tolist(), force.second.tolist()),
        "impact": lambda: Impact(float(force.first), float(force.second)),
        "samples": lambda: Sampled(force.first, problem.step),
    }[force.kind]()
    channels = tuple(Channel(dof + 1, QUANTITIES[order]) for dof, order in problem.channels)
    measurement = Measurement(problem.step, problem.samples, channels, case.record.values)
    model = lumped(problem.masses.tolist(), links, joints)
    return identify(model, Experiment([Load(force.dof + 1, signal)], measurement), estimator)


class Judgement(NamedTuple):
    """What came of a case.

    `status`, one of STATUSES; how far −2 log L is `above` the least that any method found; `seconds` of the
    processor that dynid took; the `words` of its verdict or refusal.
    """

    seed: int
    status: str
    above: float
    seconds: float
    words: str


def judged(seed):
    """Identify a random structure, and judge what came of it by the oracle."""
    this = case(seed)
    record, names = this.record, [f"j{k}.{letter}" for k, letter in this.problem.unknowns]
    begun = time.process_time()
    try:
        result = suite(this)
    except (NotIdentifiable, Diverged) as error:
        seconds = time.process_time() - begun
        failed = LOCAL if "different optima" in error.problem else WRONGLY  # the search says so itself
        status = RIGHTLY if _indistinct(this, [names.index(name) for name in error.names]) else failed
        return Judgement(seed, status, math.nan, seconds, f"{type(error).__name__}: {error.problem}")
    seconds = time.process_time() - begun
    group = "identification/parameters"
    if lost := np.flatnonzero(~result.value(f"{group}/identifiable")).tolist():
        order = [names.index(name) for name in np.array(result.value(f"{group}/name"))[lost]]
        words = str(result.value("identification/diagnostics/verdict"))
        return Judgement(seed, RIGHTLY if _indistinct(this, order) else WRONGLY, math.nan, seconds, words)
    found = dict(zip(result.value(f"{group}/name"), result.value(f"{group}/estimate"), strict=True))
    eta = np.log([found[name] for name in names])
    reached, noise = record.deviance(eta)
    above = reached - min(_least(this), record.fit(eta, noise)[1])
    converged = bool(result.value("identification/diagnostics/converged"))
    status = OPTIMUM if above <= _AT else NEAR if above <= _FAR else FALSELY if converged else LOCAL
    words = "converged" if converged else "NOT converged"
    stages = len(result.value("identification/stages/stage"))
    return Judgement(seed, status, above, seconds, f"{words}, {stages} stages")


def _least(this):
    """Return the least −2 log L that the oracle finds, from the truth and from random starts."""
    rng, spread = np.random.default_rng([7, this.seed]), np.log(10)
    ends = [this.record.fit(this.problem.truth, np.maximum(this.noise, 1e-6) * this.record.rms)]
    for _ in range(_STARTS):
        start = this.start + spread * rng.uniform(-1, 1, len(this.start))
        ends.append(this.record.fit(start, rounds=3))
    return min(value for _, value in ends)


def _indistinct(this, named):
    """Tell whether the record is unable to tell parameters: by the rank or the bound at the truth, or else
    because it hardly contradicts a value that is far too small or far too large.
    """
    problem, record = this.problem, this.record
    bound = record.deviations(problem.truth, np.maximum(this.noise, 1e-6) * record.rms)
    if not np.all(bound[named] < _BLIND):
        return True
    least = _least(this)
    for k in named:
        element, letter = problem.unknowns[k]
        others = tuple(each for place, each in enumerate(problem.unknowns) if place != k)
        for factor in (math.exp(-8), math.exp(8)):
            elements = list(problem.elements)
            elements[element] = elements[element]._replace(
                **{letter: factor * getattr(elements[element], letter)}
            )
            held = problem._replace(elements=tuple(elements), unknowns=others)
            if others and Record(held, record.values).fit(held.truth)[1] - least < _HARDLY:
                return True
    return False


def summary(judgements):
    """Return what came of cases, in lines."""
    counts = {status: sum(each.status == status for each in judgements) for status in STATUSES}
    seconds = np.array([each.seconds for each in judgements])
    answered = [each for each in judgements if not each.status.startswith("refused")]
    share = 100 * counts[OPTIMUM] / max(1, len(answered) + counts[WRONGLY])
    middle, high = np.quantile(seconds, [0.5, 0.9])
    times = f"median {middle:.2f} s, p90 {high:.2f} s, most {seconds.max():.2f} s"
    return "\n".join(
        [f"{len(judgements)} random structures; {share:.1f} % of those not refused rightly at the optimum"]
        + [f"  {count:4d} {status}" for status, count in counts.items()]
        + [f"  processor time of dynid: {times}"]
    )


if __name__ == "__main__":
    first, last, workers = (int(word) for word in (*sys.argv[1:], "1")[:3])
    with ProcessPoolExecutor(workers) as pool:
        judgements = []
        for each in pool.map(judged, range(first, last)):
            judgements.append(each)
            words = f"{case(each.seed).about}: {each.words}"
            print(
                f"{each.seed:5d} {each.status:18s} {each.above:9.2g} {each.seconds:6.2f} s  {words}",
                flush=True,
            )
    print(summary(judgements))
