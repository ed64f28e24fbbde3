"""Time and memory of the lowest ten modes of plates and solids, against SciPy's own shift-invert.

Every alternative runs in a process of its own, which reads the matrices from a file, so that its peak memory
is what it needs; alternatives take turns, and the fastest of the rounds counts.

    python benchmarks/modes.py                          the plate of 1e5 DOFs and the solid of 9e4
    python benchmarks/modes.py --sizes -o docs/modes_cost.png     cost against size, from 1e3 DOFs on
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

COUNT = 10
SIDES = {"plate": [17, 31, 57, 100, 182], "solid": [6, 9, 14, 20, 30]}
ALTERNATIVES = {"plate": ["eigsh", "splu", "cholespy", "pardiso"], "solid": ["eigsh", "splu", "pardiso"]}
# The largest size that takes a minute or more in these is left out of the curve.
LIMIT = {("solid", "splu"): 20, ("solid", "eigsh"): 20}


def run(alternative: str, file: str) -> dict[str, float | list[float]]:
    """Compute the modes in this process."""
    from scipy.sparse import csc_array, load_npz

    K, M = (csc_array(load_npz(f"{file}_{letter}.npz")) for letter in "KM")
    before = _peak()
    if alternative == "eigsh":
        from scipy.sparse.linalg import eigsh

        start, cpu = time.perf_counter(), time.process_time()
        square = eigsh(K, COUNT, M, sigma=0.0)[0]
        taken, cpu = time.perf_counter() - start, time.process_time() - cpu
        return {"time": taken, "cpu": cpu, "peak": _peak(), "read": before, "square": list(square)}
    from dynid.structure.inertia import eigenvalues_below
    from dynid.structure.modes import modes
    from dynid.structure.modes.pencil import scaled

    C = csc_array(K.shape)
    few = csc_array(np.diag(np.arange(1.0, 51)))
    modes(few, few, few @ few, 2, backend=alternative, proof=False)  # loads what is loaded on demand
    start, cpu = time.perf_counter(), time.process_time()
    found = modes(M, C, K, COUNT, backend=alternative, proof=False)
    taken, cpu, peak = time.perf_counter() - start, time.process_time() - cpu, _peak()
    start, counting_cpu = time.perf_counter(), time.process_time()
    pencil = scaled(K, M)
    just_above = float(found.omega[-1]) ** 2 * (1 + 1e-6)
    pivots = alternative if alternative == "pardiso" else "splu"
    counted, _ = eigenvalues_below(pencil.K, pencil.M, just_above, pivots)
    assert counted == COUNT, f"{counted} modes counted"
    counting, counting_cpu = time.perf_counter() - start, time.process_time() - counting_cpu
    return {
        "time": taken, "cpu": cpu, "peak": peak, "read": before, "square": list(found.omega**2),
        "counting": counting, "counting_cpu": counting_cpu, "counting_peak": _peak(),
        "residual": float(found.residuals.max()),
    }  # fmt: skip


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measured(kind: str, side: int, alternatives: list[str], rounds: int) -> tuple[int, dict[str, dict]]:
    """Return the number of DOFs and the best of the rounds by alternative."""
    from scipy.sparse import save_npz

    from dynid.bench import meshes

    K, M = getattr(meshes, kind)(side)
    size, best = K.shape[0], {}
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / kind)
        for letter, matrix in (("K", K), ("M", M)):
            save_npz(f"{file}_{letter}.npz", matrix, compressed=False)
        del K, M, matrix
        for _ in range(rounds):
            for alternative in alternatives:
                args = [sys.executable, __file__, "--run", alternative, file]
                found = json.loads(subprocess.run(args, stdout=subprocess.PIPE, check=True, text=True).stdout)
                old = best.get(alternative)
                best[alternative] = found if old is None else {
                    key: min(found[key], old[key]) if key != "square" else value for key, value in old.items()
                }  # fmt: skip
    return size, best


def table(kind: str, size: int, found: dict[str, dict]) -> None:
    """Print the figures of one size, times relative to SciPy's."""
    reference = found.get("eigsh")
    print(f"\n{kind}, {size} DOFs, {COUNT} modes")
    heads = ["time", "faster", "cpu time", "less", "peak", "count", "its peak", "with it", "differs"]
    print(" " * 11 + " ".join(f"{head:>8}" for head in heads))
    for name, one in found.items():
        line = f"{name:10} {one['time']:7.2f}s "
        faster = f"{reference['time'] / one['time']:7.2f}x" if reference else ""
        less = f"{reference['cpu'] / one['cpu']:7.2f}x" if reference else ""
        line += f"{faster:>8} {one['cpu']:7.2f}s {less:>8} {one['peak']:6.0f}MB"
        if "counting" in one:
            whole = one["time"] + one["counting"]
            ratio = f"{reference['time'] / whole:7.2f}x" if reference else ""
            line += f" {one['counting']:7.2f}s {one['counting_peak']:6.0f}MB {ratio:>8}"
            if reference:
                line += f" {np.max(np.abs(np.divide(one['square'], reference['square']) - 1)):8.1e}"
        print(line, flush=True)


def drawn(curves: dict[str, dict[str, list[tuple[int, float, float]]]], file: str) -> None:
    """Draw processor time against size: other work on the machine disturbs it least."""
    from dynid.report.formats import as_file
    from dynid.report.plot import Axis, Line, Marks, Panel, chart
    from dynid.report.plot.layers import hue

    order = list(dict.fromkeys(name for lines in curves.values() for name in lines))
    names = {"eigsh": "scipy eigsh, its default", "splu": "dynid, SuperLU (always there)"}
    panels = []
    for kind, lines in curves.items():
        layers = []
        for name, points in lines.items():
            n, seconds, counting = np.array(points).T
            cls = hue(order.index(name))
            layers += [Line(n, seconds, names.get(name, f"dynid, {name}"), cls), Marks(n, seconds, cls=cls)]
            if name == "splu":
                layers.append(Line(n, counting, "its inertia count, apart", f"{cls} dashed"))
        x, y = Axis("DOFs", log=True), Axis("processor time (s)", log=True)
        panels.append(Panel(x, y, layers, f"{kind}: the lowest {COUNT} modes"))
    svg = chart("modes-cost", "Cost of the lowest modes", [panels], width=1000.0, height=300.0)
    Path(file).write_bytes(as_file(svg, "png"))


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--run", nargs=2, metavar=("ALTERNATIVE", "FILE"), help=argparse.SUPPRESS)
    parser.add_argument("--sizes", action="store_true", help="cost against size, as a plot")
    parser.add_argument("--kind", choices=list(SIDES), action="append", help="only plates, or only solids")
    parser.add_argument("--only", action="append", help="only these alternatives")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("-o", default="docs/modes_cost.png", help="where the plot goes")
    asked = parser.parse_args()
    if asked.run:
        print(json.dumps(run(*asked.run)))
        return
    from dynid.structure.factorisation import available

    there = {"eigsh": True, **available()}
    for name in [name for name, installed in there.items() if not installed]:
        print(f"{name} is not installed and left out")
    curves: dict[str, dict[str, list[tuple[int, float, float]]]] = {}
    for kind in asked.kind or SIDES:
        for side in SIDES[kind] if asked.sizes else SIDES[kind][-1:]:
            chosen = [name for name in asked.only or ALTERNATIVES[kind] if there[name]]
            if asked.sizes:
                chosen = [name for name in chosen if side <= LIMIT.get((kind, name), side)]
            size, found = measured(kind, side, chosen, asked.rounds)
            table(kind, size, found)
            for name, one in found.items():
                point = (size, one["cpu"], one.get("counting_cpu", np.nan))
                curves.setdefault(kind, {}).setdefault(name, []).append(point)
    if asked.sizes:
        drawn(curves, asked.o)


if __name__ == "__main__":
    main()
