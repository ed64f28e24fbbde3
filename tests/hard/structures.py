"""Structures that are hard: massless, free, nearly double, ill-conditioned, huge, tiny; and how they move."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import mpmath
import numpy as np

from tests.hard.case import SHARED, Case, Refusal
from tests.hard.scenes import run

Rows = Sequence[Sequence[float]]
BY_MPMATH = "eigenvalues by mpmath with 60 digits"
FE = SHARED / "fe"


def market(rows: Rows) -> str:
    """Write a matrix as Matrix Market text."""
    entries = [
        (i, j, value) for i, row in enumerate(rows, 1) for j, value in enumerate(map(float, row), 1) if value
    ]
    size = len(rows)
    lines = [f"{i} {j} {value!r}" for i, j, value in entries]
    return "\n".join(
        ["%%MatrixMarket matrix coordinate real general", f"{size} {size} {len(entries)}", *lines, ""]
    )


def imported(
    mass: Rows, stiffness: Rows, damping: Rows | None = None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the part of a scene that imports matrices, and the files that it names."""
    given = {"mass": mass, "stiffness": stiffness} | ({"damping": damping} if damping else {})
    return (
        {"matrices": {name: f"{name}.mtx" for name in given}},
        {f"{name}.mtx": market(rows) for name, rows in given.items()},
    )


def lumped(masses: Sequence[float], links: Sequence[tuple[Any, ...]]) -> dict[str, Any]:
    """Return a chain: links are (DOFs, k) or (DOFs, k, c)."""
    described = [dict(zip(("dofs", "k", "c"), ([*link[0]], *link[1:]), strict=False)) for link in links]
    return {"lumped": {"masses": [*masses], "links": described}}


def frequencies(mass: Rows, stiffness: Rows) -> np.ndarray:
    """Return natural frequencies by mpmath; massless DOFs, if any, stand last."""
    with mpmath.workdps(60):
        M, K = (mpmath.matrix([[mpmath.mpf(x) for x in row] for row in rows]) for rows in (mass, stiffness))
        heavy = [i for i in range(len(mass)) if M[i, i] != 0]
        light = [i for i in range(len(mass)) if M[i, i] == 0]

        def part(A: Any, rows: list[int], columns: list[int]) -> Any:
            return mpmath.matrix([[A[i, j] for j in columns] for i in rows])

        condensed = part(K, heavy, heavy)
        if light:
            condensed -= part(K, heavy, light) * mpmath.inverse(part(K, light, light)) * part(K, light, heavy)
        L = mpmath.cholesky(part(M, heavy, heavy))
        inverse = mpmath.inverse(L)
        values = mpmath.eigsy(inverse * condensed * inverse.T, eigvals_only=True)
        tiny = max(values) * mpmath.mpf(10) ** -45
        return np.sort([float(mpmath.sqrt(value)) if value > tiny else 0.0 for value in values])


def chain_rows(masses: Sequence[float], springs: Mapping[tuple[int, ...], float]) -> tuple[Rows, Rows]:
    """Assemble mass and stiffness of a chain with exact sums where doubles have them."""
    n = len(masses)
    M = [[masses[i] if i == j else 0.0 for j in range(n)] for i in range(n)]
    with mpmath.workdps(60):
        K = [[mpmath.mpf(0)] * n for _ in range(n)]
        for dofs, k in springs.items():
            for i in dofs:
                K[i - 1][i - 1] += mpmath.mpf(k)
            if len(dofs) == 2:
                i, j = dofs
                K[i - 1][j - 1] -= mpmath.mpf(k)
                K[j - 1][i - 1] -= mpmath.mpf(k)
    return M, K


def modes(structure: dict[str, Any], files: Mapping[str, str], count: int | None = None) -> dict[str, Any]:
    """Ask for the modes of a structure."""
    asked = {} if count is None else {"count": count}
    scene = {"dynid": 1, "kind": "identification", "structure": structure, "analysis": {"modes": asked}}
    result = run(scene, files)
    return {
        "omega": result.value("structure/modes/omega"),
        "rigid": int(result.value("structure/modes/rigid")),
    }


def _of_matrices(name: str, mass: Rows, stiffness: Rows, bound: float, rigid: int = 0) -> Case:
    structure, files = imported(mass, stiffness)

    def known() -> dict[str, Any]:
        return {"omega": frequencies(mass, stiffness), "rigid": rigid}

    return Case(name, "structure", BY_MPMATH, partial(modes, structure, files), known, bound)


def _of_chain(
    name: str, masses: Sequence[float], springs: Mapping[tuple[int, ...], float], bound: float, rigid: int = 0
) -> Case:
    structure = lumped(masses, [*springs.items()])

    def known() -> dict[str, Any]:
        unit = masses[0]
        scaled = {dofs: mpmath.mpf(k) / unit for dofs, k in springs.items()}
        rows = chain_rows([mpmath.mpf(mass) / unit for mass in masses], scaled)
        return {"omega": frequencies(*rows), "rigid": rigid}

    return Case(name, "structure", BY_MPMATH, partial(modes, structure, {}), known, bound)


def _free_pairs(pairs: int) -> Case:
    """Pairs of masses on nothing: as many rigid modes, as many elastic ones of one frequency."""
    springs = {(2 * i + 1, 2 * i + 2): 8.0 for i in range(pairs)}
    structure = lumped([1.0] * (2 * pairs), [*springs.items()])
    known = {"omega": np.array([0.0] * pairs + [4.0] * pairs), "rigid": pairs}
    name = f"{pairs} rigid modes beside a frequency of multiplicity {pairs}"
    return Case(name, "structure", "by hand", partial(modes, structure, {}), known, 1e-15)


def _near_double(gap: float) -> list[Case]:
    weak = {(1,): 1.0, (2,): 1.0, (1, 2): gap / 2}
    M = np.eye(2).tolist()
    c, s = 0.6, 0.8
    mixed = [[c * c + s * s * (1 + gap), -c * s * gap], [-c * s * gap, s * s + c * c * (1 + gap)]]
    return [
        _of_chain(f"equal oscillators coupled by {gap / 2:g}", [1.0, 1.0], weak, 1e-15),
        _of_matrices(f"modes {gap:g} apart in mixed coordinates", M, mixed, 1e-15),
    ]


def _published(name: str) -> Case:
    file = FE / "eigenvalues.json"
    structure = {
        "matrices": {"mass": str(FE / f"bcsstm{name}.mtx"), "stiffness": str(FE / f"bcsstk{name}.mtx")}
    }

    def known() -> dict[str, Any]:
        listed = json.loads(file.read_text(encoding="utf-8"))
        return {"omega": np.sqrt(_lowest(listed, name))}

    ask = partial(modes, structure, {}, 12)
    return Case(
        f"bcsstk{name}, bcsstm{name}", "structure", "Harwell-Boeing collection", ask, known, 1e-9, needs=file
    )


def _lowest(listed: Any, name: str) -> np.ndarray:
    return np.array(listed[f"bcsstk{name}/bcsstm{name}"]["lowest_lambda"][:12])


# --- matrices that are no structure --------------------------------------------------------------


def _refused(name: str, mass: Rows, stiffness: Rows, damping: Rows | None, says: str, remedy: str) -> Case:
    structure, files = imported(mass, stiffness, damping)
    ask = partial(modes, structure, files)
    return Case(name, "structure", "no such structure", ask, Refusal(says, remedy))


# --- responses -----------------------------------------------------------------------------------


def _responding(
    structure: dict[str, Any], files: Mapping[str, str], force: int, output: int, quantity: str, omega: float
) -> np.ndarray:
    scene = {
        "dynid": 1,
        "kind": "identification",
        "structure": structure,
        "analysis": {
            "frequency": {"start": omega, "stop": max(omega, 1e-300), "points": 1, "scale": "linear"},
            "inputs": [force],
            "outputs": [{"dof": output, "quantity": quantity}],
        },
    }
    return run(scene, files).value("structure/frequency_response/response")[:, 0, 0]


def _response(
    name: str,
    rows: tuple[Rows, Rows, Rows],
    ports: tuple[int, int, str],
    omega: float,
    known: complex | None = None,
    bound: float = 1e-12,
) -> Case:
    mass, damping, stiffness = rows
    structure, files = imported(mass, stiffness, damping if np.any(damping) else None)

    def solved() -> np.ndarray:
        with mpmath.workdps(60):
            M, C, K = (mpmath.matrix([[mpmath.mpf(x) for x in row] for row in part]) for part in rows)
            s = mpmath.mpc(0, omega)
            force, output, quantity = ports
            right = mpmath.zeros(len(mass), 1)
            right[force - 1] = 1
            power = ("displacement", "velocity", "acceleration").index(quantity)
            return np.array([complex(s**power * mpmath.lu_solve(s * s * M + s * C + K, right)[output - 1])])

    source = "linear equations by mpmath with 60 digits" if known is None else "by hand"
    answer = solved if known is None else np.array([known])
    ask = partial(_responding, structure, files, *ports, omega)
    return Case(name, "structure", source, ask, answer, bound)


def _responses() -> list[Case]:
    one, none = [[4.0]], [[0.0]]
    ring = (one, none, [[100.0]])
    row = (np.eye(3).tolist(), np.zeros((3, 3)).tolist(), [[3.0, -1, 0], [-1, 2, -1], [0, -1, 3.0]])
    pole = float(np.sqrt(3.0))
    free = ([[1.0, 0], [0, 3.0]], np.zeros((2, 2)).tolist(), [[8.0, -8], [-8, 8]])
    uneven = (
        [[1.0, 0], [0, 1e-6]],
        [[0.0, 0], [0, 30.0]],
        [[2e4, -1e4], [-1e4, 1e4]],
    )
    dashed = ([[1.0, 0], [0, 3.0]], [[5.0, 0], [0, 0]], [[8.0, -8], [-8, 8]])
    return [
        _response(
            "a mass on a spring exactly at its pole", ring, (1, 1, "displacement"), 5.0, complex(np.inf)
        ),
        _response(
            "a mass on a spring 1e-12 beside its pole",
            ring,
            (1, 1, "displacement"),
            5 * (1 + 1e-12),
            None,
            1e-3,
        ),
        _response(
            "a mass on a spring 1e-6 beside its pole", ring, (1, 1, "velocity"), 5 * (1 + 1e-6), None, 1e-9
        ),
        # The middle is a node of the mode at sqrt(3): by hand each end holds half of a force there.
        _response("at a pole whose node the force is at", row, (2, 1, "displacement"), pole, -0.5 + 0j),
        _response("at a pole whose node the sensor is at", row, (1, 2, "displacement"), pole, -0.5 + 0j),
        _response("at a pole, beside its node", row, (1, 3, "displacement"), pole, complex(np.inf)),
        _response("a free body at rest: displacement", free, (1, 2, "displacement"), 0.0, complex(np.inf)),
        _response("a free body at rest: velocity", free, (1, 2, "velocity"), 0.0, complex(np.inf)),
        _response("a free body at rest: acceleration", free, (1, 2, "acceleration"), 0.0, 0.25 + 0j),
        _response("a free body on a damper at rest: velocity", dashed, (2, 2, "velocity"), 0.0, 0.2 + 0j),
        _response("masses of 1 and 1e-6 kg, damped unevenly, slow", uneven, (1, 2, "velocity"), 1e-3),
        _response("masses of 1 and 1e-6 kg, damped unevenly, fast", uneven, (1, 2, "velocity"), 1e5),
        _response(
            "a heavily and unevenly damped pair at its resonance",
            ([[1.0, 0], [0, 1.0]], [[200.0, -199], [-199, 199.5]], [[200.0, -100], [-100, 100]]),
            (1, 2, "acceleration"),
            7.0,
        ),
    ]


def _moving(
    structure: dict[str, Any],
    output: dict[str, Any],
    stop: float,
    excitation: list[Any],
    displaced: list[int],
) -> np.ndarray:
    scene = {
        "dynid": 1,
        "kind": "identification",
        "structure": structure,
        "excitation": excitation,
        "analysis": {"time": {"stop": stop, "step": stop / 4}, "outputs": [output]},
    }
    text = json.dumps(scene)[:-1] + f', "initial": {{{", ".join(f"{dof}: {{x: 1}}" for dof in displaced)}}}}}'
    return run(text).value("structure/time_response/response")[-1]


def _motions() -> list[Case]:
    push = [{"dof": 1, "kind": "step", "amplitude": 6.0}]
    stiff = lumped([1.0, 1.0], [((1,), 1.0), ((1, 2), 1e9)])

    def slow() -> np.ndarray:
        """Of two masses on a link of 1e9 the slow mode at t = 10, started alike."""
        with mpmath.workdps(60):
            values = frequencies(*chain_rows([1.0, 1.0], {(1,): 1.0, (1, 2): 1e9}))
            return np.array([float(mpmath.cos(mpmath.mpf(float(values[0])) * 10))])

    first = {"dof": 1, "quantity": "displacement"}
    return [
        Case(
            "a free body pushed for 1e6 s",
            "structure",
            "by hand: F t^2 / (2 m), and F / k of the spring",
            partial(_moving, lumped([1.0, 2.0], [((1, 2), 3.0, 40.0)]), first, 1e6, push, []),
            np.array([1e12 + 8 / 9 * 1.0]),
            1e-10,
        ),
        Case(
            "4e4 rad/s beside 0.7 rad/s for 10 s",
            "structure",
            BY_MPMATH,
            partial(_moving, stiff, first, 10.0, [], [1, 2]),
            slow,
            1e-5,  # 7 rad of phase times cond(K), rounded
        ),
        Case(
            "a mass of 1e-15 kg on 1 N/m, a million periods",
            "structure",
            "closed form, mpmath",
            partial(_moving, lumped([1e-15], [((1,), 1.0)]), first, 0.2, [], [1]),
            lambda: np.array([float(mpmath.cos(mpmath.mpf("0.2") / mpmath.sqrt(mpmath.mpf(1e-15))))]),
            2e-8,  # 6e6 rad of phase, rounded
        ),
    ]


def _tip(name: str, length: float, EI: float, mass: float) -> Case:
    """A massless cantilever of many elements with a mass at its tip: k = 3 E I / L^3, whatever the mesh."""
    beam = {
        "elements": 20,
        "length": length,
        "EI": EI,
        "rhoA": 0,
        "supports": [{"node": 1, "fix": ["w", "theta"]}],
        "masses": [{"node": 21, "m": mass}],
    }
    known = {"omega": np.array([np.sqrt(3 * EI / length**3 / mass)])}
    ask = partial(modes, {"beam": beam}, {})
    return Case(f"massless cantilever: {name}", "structure", "closed form: 3 E I / L^3", ask, known, 1e-9)


def _cases() -> list[Case]:
    light = [1.0, 0.0, 1.0, 0.0, 0.0, 2.0]
    springs = [[0.0] * 6 for _ in range(6)]
    for i in range(6):
        springs[i][i] += 2.0 if i < 5 else 1.0
        if i < 5:
            springs[i][i + 1] = springs[i + 1][i] = -1.0
    singular = [[light[i] if i == j else 0.0 for j in range(6)] for i in range(6)]
    cases = [
        _of_matrices("three massless DOFs between masses", singular, springs, 1e-14),
        _of_matrices(
            "a massless DOF that carries nothing but a spring to ground",
            [[1.0, 0], [0, 0.0]],
            [[4.0, 0], [0, 9.0]],
            1e-15,
        ),
        *(_published(name) for name in ("01", "03", "08")),
        *(_free_pairs(pairs) for pairs in range(1, 7)),
        *(case for gap in (1e-6, 1e-8, 1e-10, 1e-12) for case in _near_double(gap)),
    ]
    for size in (1e6, 1e10, 1e12):
        chain = {(1,): 1.0, (1, 2): size, (2, 3): size}
        cases.append(
            _of_chain(f"cond(K) of {size:.0e}: a stiff train on a soft spring", [1.0] * 3, chain, 1e-9)
        )
    for size in (1e15, 1e16):
        chain = lumped([1.0] * 3, [((1,), 1.0), ((1, 2), size), ((2, 3), size)])
        name = f"cond(K) of {size:.0e}: a stiff train on a soft spring"
        answer = Refusal("1 N/m from DOF 1 to ground is lost", "rigid")
        cases.append(Case(name, "structure", "1 + 1e16 is no double", partial(modes, chain, {}), answer))
    for size in (1e15, 1e-15, 1e100, 1e-100):
        chain = {(1,): 2 * size, (1, 2): 3 * size, (2, 3): size}
        masses = [1.0 * size, 2.0 * size, 0.5 * size]
        cases.append(_of_chain(f"masses and springs times {size:g}", masses, chain, 1e-14))
    cases += [
        _of_chain("GN/µm: 1e15 N/m on 1e-3 kg", [1e-3, 2e-3], {(1,): 1e15, (1, 2): 3e15}, 1e-14),
        _of_chain("a mass of 1e-12 beside one of 1e12", [1e12, 1e-12], {(1,): 1.0, (1, 2): 1.0}, 1e-13),
        _tip("10 m of steel", 10.0, 2e6, 500.0),
        _tip("100 µm of silicon", 1e-4, 1.4e-13, 2e-12),
    ]
    two = np.eye(2).tolist()
    cases += [
        _refused("an unsymmetric stiffness", two, [[2.0, -1], [-0.5, 2]], None, "symmetric", "."),
        _refused("a gyroscopic damping", two, [[2.0, -1], [-1, 2]], [[0.0, 3], [-3, 0]], "symmetric", "."),
        _refused("a negative mass", [[1.0, 0], [0, -1]], [[2.0, -1], [-1, 2]], None, "mass is negative", "."),
        _refused("a stiffness that buckles", two, [[1.0, -2], [-2, 1]], None, "stiffness is indefinite", "."),
    ]
    return cases + _responses() + _motions()


CASES = _cases()
