"""Every reduction method on structures that are hard to reduce: what is exact by theory stays exact."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from tests.hard.case import Case, Refusal
from tests.hard.scenes import run
from tests.hard.structures import Rows, chain_rows, frequencies, imported, lumped
from tests.structure.oracle import exact, irs

#: What is retained exactly, and by which method: all of it by as many modes; where what is condensed has no
#: mass by static condensation; and the modes between a boundary by as many fixed-interface modes.
EXACT = "exact by theory; eigenvalues by mpmath with 60 digits"


def _reduced(structure: dict[str, Any], files: Mapping[str, str], method: dict[str, Any]) -> dict[str, Any]:
    scene = {"dynid": 1, "kind": "reduction", "structure": structure, "reduction": [method]}
    return {"omega": run(scene, files).value(f"reduction/{method['method']}/frequencies")}


def _methods(
    masters: list[int], modes: list[int], fixed: int, *, massless: bool = False
) -> list[dict[str, Any]]:
    """Return methods that keep the modes exactly; the static ones where nothing else has mass."""
    kept = {"masters": masters, "modes": modes}
    methods: list[dict[str, Any]] = [
        {"method": "serep", **kept},
        {"method": "joint-aware", **kept},
        {"method": "modal", "modes": modes},
        {"method": "craig-bampton", "masters": masters, "modes": {"count": fixed}},
    ]
    if massless:
        methods += [
            {"method": "guyan", "masters": masters},
            {"method": "irs", "masters": masters, "iterations": 2},
            {"method": "dynamic", "masters": masters, "frequency": 0.3},
        ]
    return methods


def _on(
    name: str,
    mass: Rows,
    stiffness: Rows,
    methods: list[dict[str, Any]],
    bound: float,
    count: int,
    source: Any = None,
) -> list[Case]:
    structure, files = source or imported(mass, stiffness)

    def known(many: int) -> dict[str, Any]:
        return {"omega": frequencies(mass, stiffness)[:many]}

    return [
        Case(
            f"{method['method']} on {name}",
            "structure",
            EXACT,
            partial(_reduced, structure, files, method),
            partial(
                known,
                len(mass)
                if method["method"] == "craig-bampton" and count < len(mass) and not _light(mass)
                else count,
            ),
            bound,
        )
        for method in methods
    ]


def _light(mass: Rows) -> bool:
    return any(mass[i][i] == 0 for i in range(len(mass)))


def _chain(masses: list[float], springs: dict[tuple[int, ...], float]) -> tuple[Rows, Rows, Any]:
    return (*chain_rows(masses, springs), (lumped(masses, [*springs.items()]), {}))


def _graded(name: str, masses: list[float], links: dict[tuple[int, ...], float], masters: list[int]) -> Case:
    """Return IRS of a chain whose springs and masses differ by many decades."""
    method = {"method": "irs", "masters": masters}

    def known() -> dict[str, Any]:
        return {"omega": irs(*exact(masses, list(links.items())), masters, 1)}

    ask = partial(_reduced, lumped(masses, [*links.items()]), {}, method)
    source = "the method's formulas by mpmath with 90 digits"
    return Case(f"irs on a graded chain of {name}", "structure", source, ask, known, 1e-9)


def _refused(name: str, method: dict[str, Any], says: str) -> Case:
    """Of a row of three, held at both ends, the middle mass is a node of the second mode."""
    row = lumped([1.0, 1.0, 1.0], [((1,), 1.0), ((1, 2), 1.0), ((2, 3), 1.0), ((3,), 1.0)])
    ask = partial(_reduced, row, {}, method)
    return Case(name, "structure", "by hand: a node of the mode", ask, Refusal(says))


def _cases() -> list[Case]:
    diagonal = [1.0, 0.0, 2.0, 0.0]
    M = [[diagonal[i] if i == j else 0.0 for j in range(4)] for i in range(4)]
    K = [[2.0, -1, 0, 0], [-1, 2, -1, 0], [0, -1, 2, -1], [0, 0, -1, 1.5]]
    cases = _on("massless DOFs", M, K, _methods([1, 3], [1, 2], 0, massless=True), 1e-14, 2)
    M, K, chain = _chain([1.0, 2.0, 1.0, 3.0], {(1, 2): 1.0, (2, 3): 2.0, (3, 4): 1.0})
    cases += _on("a free chain", M, K, _methods([1, 4], [1, 2], 2), 1e-13, 2, chain)
    gap = 1e-9
    M, K, chain = _chain([1.0, 1.0, 1.0], {(1,): 1.0, (2,): 1.0, (1, 2): gap / 2, (3,): 9.0, (2, 3): 1e-3})
    cases += _on("modes 1e-9 apart", M, K, _methods([1, 2], [1, 2], 1), 1e-12, 2, chain)
    for unit in (1e12, 1e-12):
        springs = {(1,): unit, (1, 2): 2 * unit, (2, 3): unit}
        M, K, chain = _chain([unit, 2 * unit, unit], springs)
        cases += _on(f"masses and springs times {unit:g}", M, K, _methods([1, 3], [1, 2], 1), 1e-13, 2, chain)
    M, K, chain = _chain([1.0] * 3, {(1,): 1.0, (1, 2): 1e10, (2, 3): 1e10})
    cases += _on("cond(K) of 1e10", M, K, _methods([1, 3], [1, 2], 1), 1e-5, 2, chain)
    cases += [
        _graded(
            "6, 11 decades",
            [3.94, 0.0583, 21500.0, 0.000607, 6.6e-05, 129000.0],
            {(1, 2): 47.8, (2, 3): 0.00152, (3, 4): 2.12e6, (4, 5): 0.0818, (5, 6): 3.09e8, (1,): 0.00326},
            [1, 3, 4],
        ),
        _graded(
            "5, 9 decades",
            [2.5e-5, 310.0, 0.0078, 4.4e4, 1.2],
            {(1, 2): 7.1e6, (2, 3): 0.042, (3, 4): 9.3e5, (4, 5): 0.61, (1,): 0.0077},
            [2, 4, 5],
        ),
    ]
    # Static condensation onto the middle of a symmetric row: (1/2, 1, 1/2), so k = 1, m = 3/2.
    row = lumped([1.0] * 3, [((1,), 1.0), ((1, 2), 1.0), ((2, 3), 1.0), ((3,), 1.0)])
    guyan = {"method": "guyan", "masters": [2]}
    known = {"omega": np.array([np.sqrt(2 / 3)])}
    cases.append(
        Case(
            "guyan onto a node of a mode",
            "structure",
            "by hand",
            partial(_reduced, row, {}, guyan),
            known,
            1e-15,
        )
    )
    cases += [
        _refused(
            "serep of a mode whose node the master is", {"method": "serep", "masters": [2], "modes": [2]}, "."
        ),
        _refused(
            "joint-aware of a mode whose node the master is",
            {"method": "joint-aware", "masters": [2], "modes": [2]},
            "mode 2 is invisible",
        ),
        _refused(
            "dynamic condensation at a resonance of what is condensed",
            {"method": "dynamic", "masters": [2], "frequency": float(np.sqrt(2.0))},
            "slaves resonate",
        ),
    ]
    return cases


CASES = _cases()
