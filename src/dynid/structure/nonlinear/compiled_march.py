"""The march by machine code (`native/march.c`): the same steps, in a hundredth of the time.

The code stops where the laws enter a combination of regimes for the first time; its tables are made here,
and it goes on. Laws that have no `code`, and structures whose eigenvectors are ill conditioned, are left to
NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.native import call, structure
from dynid.structure.law import BoundLaw
from dynid.structure.nonlinear.tables import (
    NODES,
    SCAN,
    Columns,
    LinearRest,
    Motion,
    Refine,
    Regime,
    Regimes,
    Steps,
    first_regimes,
    legendre_coefficients,
    load_points,
    load_polynomials,
    lobatto,
    powers_of,
)

# What `dynid_march` returns.
_DONE, _NEEDS_REGIME, _NOT_DIAGONAL, _NEEDS_MEMORY = 0, 1, 2, 4
# Parameters of a law; its slopes by these and, the last, by its offset; numbers of it that are no parameters.
_PARAMETERS, _SLOPES, _OPTIONS = 4, 6, 6
# Reversals that a law remembers at first; the room is doubled where there are more.
_MEMORY = 16


def _plain(array: Any) -> Array:
    return np.require(array, float, ["C", "W"])


def _padded(numbers: Sequence[float], width: int) -> list[float]:
    return [*numbers, *[0.0] * (width - len(numbers))]


def law_tables(laws: Sequence[BoundLaw]) -> dict[str, Any]:
    """Return codes, rows, options, values and offsets of laws, as the code has them."""
    return {
        "codes": np.array([law.law.code for law in laws], dtype=np.int64),
        "places": np.array([law.row for law in laws], dtype=np.int64),
        "options": _plain([_padded(law.law.options, _OPTIONS) for law in laws]),
        "values": _plain([_padded(law.values, _PARAMETERS) for law in laws]),
        "offsets": _plain([law.offset for law in laws]),
    }


def by_law_tables(laws: Sequence[BoundLaw], by_laws: Sequence[Array] | None, p: int) -> Array:
    """Return the derivatives of the parameters of laws and, last, of their offsets (laws x slopes x p)."""
    out = np.zeros((len(laws), _SLOPES, p))
    for table, by in zip(out, by_laws or (), strict=False):
        table[: len(by) - 1], table[-1] = by[:-1], by[-1]
    return out


def march(
    regimes: Regimes,
    steps: Steps,
    x0: Array,
    z0: Array,
    columns: Columns | None,
    *,
    first: bool,
    impulse: tuple[int, Array] | None,
) -> Motion | None:
    """Return the motion as `march.march`; None where NumPy has to follow it. Raises Refine as that."""
    rest, laws = regimes.rest, regimes.laws
    n, nf, nl = len(x0), rest.forces, len(laws)
    p = 0 if columns is None else len(columns.by_rows)
    q, samples = p + (n + nl) * first, len(steps.samples)
    lengths, which = np.unique(steps.lengths, return_inverse=True)
    sample = np.full(len(steps.lengths) + 1, -1, dtype=np.int64)
    sample[steps.samples] = np.arange(samples)
    last = int(steps.samples[-1])
    (c, L, integrals), (points, inverse), legendre = lobatto(), load_points(), legendre_coefficients()
    S, T = np.zeros((n, q)), np.zeros((nl, q))
    if first:
        S[:, p : p + n], T[:, p + n :] = np.eye(n), np.eye(nl)
    acceleration = rest.rows[nf : 2 * nf]
    state: dict[str, Any] = {
        "x": x0.copy(), "z": z0.copy(), "S": S, "T": T, "work": np.zeros(nf + 4), "done": np.zeros(1),
        "wanted": np.zeros(2 * nf), "state": np.array(first_regimes(rest, laws, x0, z0), dtype=np.int64),
        "at": np.zeros(4, dtype=np.int64), "open": np.zeros(nl, dtype=np.int64),
        "began": np.zeros(nl), "began_slopes": np.zeros((nl, q)),
    }  # fmt: skip
    remembers = any(law.law.remembers for law in laws)
    loops: dict[str, Any] = {"loops": np.zeros((nl, 2 * _MEMORY))}
    loops["loop_slopes"] = np.zeros((nl, 2 * _MEMORY, q if remembers else 0))
    out: dict[str, Any] = {
        "states": np.empty((samples, n)), "hidden": np.empty((samples, nl)),
        "forces": np.empty((samples, nf)), "works": np.empty((samples, nf + 2)),
        "slopes": np.empty((samples, n, q)), "force_slopes": np.empty((samples, nf, q)),
        "hidden_slopes": np.empty((samples, nl, q)),
        "regime_of": np.empty((samples, nl), dtype=np.int64),
    }  # fmt: skip
    fixed: dict[str, Any] = {
        "rows": rest.all_rows, "D": rest.D, "rate_A": acceleration @ rest.A, "rate_D": acceleration @ rest.D,
        **law_tables(laws),
        "statics": [
            [float(f.value), float(f.d), *_padded([float(s) for s in f.p], _PARAMETERS)]
            for f in (law.static for law in laws)
        ],
        "by_laws": by_law_tables(laws, None if columns is None else columns.laws, p),
        "by_rows": np.zeros(0), "by_loads": np.zeros(0), "by_forces": np.zeros(0),
        "h": lengths, "fades": np.exp(-regimes.fading(state["state"].tolist()) * lengths),
        "coefficients": steps.coefficients, "nodes": c, "basis": L, "integrals": integrals,
        "scan": SCAN, "scan_basis": np.vander(SCAN, NODES, increasing=True) @ L.T,
        "load_basis": load_polynomials(c), "load_points": points, "load_inverse": inverse,
        "load_powers": powers_of("Chebyshev"),
        "legendre": legendre[0], "two_steps": legendre[1],
        "jump": np.zeros(n) if impulse is None else impulse[1],
        "jump_work": np.zeros(n) if impulse is None else rest.work_of(impulse[1]),
        "which": which.astype(np.int64), "sample": sample,
    }  # fmt: skip
    if columns is not None:
        fixed |= {"by_rows": columns.by_rows, "by_loads": columns.by_loads, "by_forces": columns.by_forces}
    integers = {"codes", "places", "which", "sample"}
    fixed = {name: array if name in integers else _plain(array) for name, array in fixed.items()}
    entered = [regimes.at(state["state"].tolist())]
    tables = _tables(rest, entered, lengths)
    while True:
        members = structure(
            n=n, nf=nf, nu=rest.loads, nd=rest.D.shape[1], nr=len(rest.all_rows), ns=len(rest.rows), nl=nl,
            q=q, p=p, m=tables["lam"].shape[1] // 2, steps=last, lengths=len(lengths), regimes=len(entered),
            scans=len(SCAN), impulse=-1 if impulse is None else impulse[0],
            memory=loops["loops"].shape[1] // 2, **fixed, **tables, **state, **loops, **out,
        )  # fmt: skip
        status = call("dynid_march", members)
        if status == _DONE:
            break
        if status == _NOT_DIAGONAL:
            return None
        if status == _NEEDS_MEMORY:
            loops = {
                name: np.concatenate([room, np.zeros_like(room)], axis=1) for name, room in loops.items()
            }
            continue
        if status != _NEEDS_REGIME:
            raise Refine("the joint forces of a step do not converge, or their regimes change without end")
        entered.append(regimes.folding(state["wanted"][:nf].copy(), state["wanted"][nf:].copy()))
        tables = _tables(rest, entered, lengths)
    names = ("states", "hidden", "forces", "regime_of", "works", "slopes", "force_slopes", "hidden_slopes")
    arrays = (out[name] for name in names)
    return Motion._make((*arrays, *map(int, state["at"][1:3]), float(state["work"][-1])))


def _tables(rest: LinearRest, regimes: Sequence[Regime], lengths: Array) -> dict[str, Any]:
    """Return the tables and modes of the regimes, one after the other, as the code has them."""
    regular = [[regime.tables(float(h), regular=True) for h in lengths] for regime in regimes]
    arrays: dict[str, Any] = {
        "k": [regime.k for regime in regimes], "c": [regime.c for regime in regimes],
        "P": [[table.P for table in row] for row in regular],
        "Q": [[_grouped(rest, table.Q, table.U) for table in row] for row in regular],
        "TR": [[table.rows for table in row] for row in regular],
        "beyond": [[table.beyond for table in row] for row in regular],
        "TI": [[_grouped(rest, table.influence, table.by_loads) for table in row] for row in regular],
    }  # fmt: skip
    # Of a pair of conjugate modes the one above the real axis, twice; modes that are absent are zeros.
    n, rows = len(rest.A), rest.all_rows
    kept = [
        np.zeros(0, dtype=int) if r.modes is None else np.flatnonzero(r.modes[0].imag >= 0) for r in regimes
    ]
    m = max([1, *map(len, kept)])
    shapes = {"lam": (m,), "V": (n, m), "iV": (m, n), "iVD": (m, rest.D.shape[1]), "RV": (len(rows), m)}
    modes = {name: np.zeros((len(regimes), *shape), dtype=complex) for name, shape in shapes.items()}
    for index, (regime, keep) in enumerate(zip(regimes, kept, strict=True)):
        if regime.modes is None:
            continue
        lam, V, inverse = regime.modes
        count, V = len(keep), V[:, keep] * np.where(lam[keep].imag > 0, 2.0, 1.0)
        modes["lam"][index, :count], modes["V"][index, :, :count] = lam[keep], V
        modes["iV"][index, :count], modes["iVD"][index, :count] = inverse[keep], inverse[keep] @ rest.D
        modes["RV"][index, :, :count] = rows @ V
    arrays |= {name: array.view(float) for name, array in modes.items()}
    diagonal = np.array([regime.modes is not None for regime in regimes], dtype=np.int64)
    return {**{name: _plain(array) for name, array in arrays.items()}, "diagonal": diagonal}


def _grouped(rest: LinearRest, forces: Array, loads: Array) -> Array:
    """Return responses to the joints' forces at all nodes, then to the loads, then to further forces."""
    joints, further = np.split(forces, [rest.forces], axis=-1)
    return np.concatenate([X.reshape(*X.shape[:-2], -1) for X in (joints, loads, further)], axis=-1)
