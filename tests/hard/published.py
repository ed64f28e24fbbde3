"""Published systems and rational functions that are hard for double precision."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dynid.lti import roots, zeros_poles
from tests.hard.case import SHARED, Case

SYSTEMS = SHARED / "zeros/state_space.json"
FUNCTIONS = SHARED / "zeros/transfer_function.json"
MODELS = {"building": "building", "cdplayer": "cdplayer_11"}
ENGINES = {"exact": "exact", "float": "floating-point"}


def _read(file: Path) -> list[dict[str, Any]]:
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else []


def _repeated(listed: list[list[float]]) -> np.ndarray:
    return np.array([complex(re, im) for re, im, many in listed for _ in range(int(many))], dtype=complex)


def _system(given: dict[str, Any], engine: str) -> dict[str, np.ndarray]:
    found = zeros_poles(*(given[key] for key in "ABCDE"), engine=engine, reading="decimal")
    return {"zeros": found.zeros, "poles": found.poles}


def _function(given: dict[str, Any]) -> dict[str, np.ndarray]:
    found = roots(given["num_exact"], given["den_exact"])
    return {"zeros": found.zeros, "poles": found.poles}


def _model(name: str, engine: str) -> dict[str, np.ndarray]:
    from scipy.io import loadmat
    from scipy.sparse import issparse

    model = loadmat(SHARED / f"fe/official_{name}.mat", spmatrix=False)
    A, B, C = (part.toarray() if issparse(part) else part for part in (model[key] for key in "ABC"))
    found = zeros_poles(A, B[:, :1], C[:1], 0, engine=engine)
    return {"zeros": found.zeros, "poles": found.poles}


def _known_model(name: str) -> dict[str, np.ndarray]:
    known = json.loads((SHARED / f"zeros/mor_{MODELS[name]}.json").read_text(encoding="utf-8"))
    return {key: _repeated(known[key]) for key in ("zeros", "poles")}


def _cases() -> list[Case]:
    cases = [
        Case(
            f"{given['name']}, {ENGINES[engine]} engine",
            "frequency",
            given["source"].split(":")[0].split(" GitHub ")[-1],
            partial(_system, given, engine),
            {"zeros": _repeated(given["exact_invariant_zeros"]), "poles": _repeated(given["exact_poles"])},
            bound,
            needs=SYSTEMS,
        )
        for given in _read(SYSTEMS)
        for engine, bound in (("exact", 1e-15), ("float", 1e-13))
    ]
    cases += [
        Case(
            given["name"],
            "frequency",
            given["source"].split(":")[0],
            partial(_function, given),
            {"zeros": _repeated(given["zeros"]), "poles": _repeated(given["poles"])},
            1e-15,
            needs=FUNCTIONS,
        )
        for given in _read(FUNCTIONS)
    ]
    for name, engine, bound in (("building", "exact", 1e-14), ("building", "float", 1e-12)):
        cases.append(
            Case(
                f"SLICOT {name} model, {ENGINES[engine]} engine",
                "frequency",
                "SLICOT model-reduction benchmarks; exact arithmetic",
                partial(_model, name, engine),
                partial(_known_model, name),
                bound,
                needs=SHARED / f"zeros/mor_{MODELS[name]}.json",
            )
        )
    return cases


CASES = _cases()
