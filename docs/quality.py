"""Write docs/quality.md out of the figures in docs/quality: `python docs/quality.py`.

The figures are kept there by `python -m tests.fuzz.record --keep`, `tests.fuzz.record run --keep`,
`tests.fuzz.files --keep`, `tests.fuzz.guided --keep` and `python -m tests.mutants --keep`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from tests.mutants.equivalent import EQUIVALENT  # noqa: E402

HEADER = """\
# Hostile input and mutation tests

Written by `python docs/quality.py` from the figures in `docs/quality`, which the commands below store.
"""
SCENES = """\
## Hostile scenes

`python -m tests.fuzz.record` mutates the example scenes in eleven ways and passes each to `dynid check`,
or to `dynid run` with the argument `run`. Required are an exit code and, for a refused scene, a message
with line and column; no traceback, no internal error, at most {check} s of CPU time for a check and {run}
s for a run, at most 6 GiB, and no file changed or created beside the scene. The same seed gives the same
scene.
"""
FILES = """\
## Damaged files

`python -m tests.fuzz.files` flips bits, sets bytes and truncates a valid file of every supported format.
A file must be read or refused with one sentence.
"""
GUIDED = """\
## Guided by coverage

`python -m tests.fuzz.guided` lets Atheris (libFuzzer) mutate scenes and files to reach new lines of
dynid. Its corpus consists of the inputs that did.
"""
MUTANTS = """\
## Mutants

`python -m tests.mutants` introduces one small error at a time into the reduction of bond graphs and into
the filter: another comparison, operator, constant or word, swapped arguments, a missing statement,
condition or return value. A test must detect it. Messages are not mutated. `--sample N --seed S` tries a
reproducible selection.

{chosen} of the {mutants} mutants were tried, chosen by chance.
"""


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(map(_written, line))} |" for line in lines) + "\n"


def _written(cell: object) -> str:
    return f"{cell:,}" if isinstance(cell, int) else str(cell).replace("|", "\\|")


def _ending(code: str) -> str:
    return "stopped" if code == "None" else f"exit {code}"


def scenes(record: dict) -> str:
    """Return what came of hostile scenes, of each kind and together."""
    codes = sorted(record["codes"])
    rows = [
        (kind, sum(c.values()), *(f"{c.get(code, 0):,}" for code in codes))
        for kind, c in record["kinds"].items()
    ]
    rows.append(("**all**", record["scenes"], *(f"{record['codes'][code]:,}" for code in codes)))
    text = table(
        ["kind", "scenes", *(_ending(code) for code in codes)], [(a, f"{b:,}", *c) for a, b, *c in rows]
    )
    seconds, seed = record["slowest"]
    text += f"\n{record['messages']:,} lines of messages. Slowest: {seconds} s of CPU time (seed {seed}). "
    text += (
        f"Peak memory: {record['peak_MB']} MB. Scenes that broke something: **{len(record['broken'])}**.\n"
    )
    if mended := record.get("mended"):
        seeds = ", ".join(str(seed) for seed, *_ in mended)
        text += f"Judged again after what they found was mended, and no longer counted: seeds {seeds}.\n"
    return text + "".join(f"\n- seed {seed} ({kind}): {wrong}" for seed, kind, wrong in record["broken"])


def page(folder: Path = HERE / "quality") -> str:
    """Return the page."""
    from tests.fuzz.record import SECONDS

    fuzz, parts = json.loads((folder / "fuzz.json").read_text()), [HEADER, SCENES.format(**SECONDS)]
    for command in ("check", "run"):
        if command in fuzz:
            parts += [f"### `dynid {command}`\n", scenes(fuzz[command])]
    if "files" in fuzz:
        outcomes = sorted({"read", "refused", *(name for found in fuzz["files"].values() for name in found)})
        rows = [(name, *(f"{found.get(o, 0):,}" for o in outcomes)) for name, found in fuzz["files"].items()]
        parts += [FILES, table(["format", *outcomes], rows)]
    if "guided" in fuzz:
        columns = ["inputs", "read", "refused", "broken", "corpus", "slowest", "seconds"]
        rows = [(name, *(found.get(c, "") for c in columns)) for name, found in fuzz["guided"].items()]
        parts += [GUIDED, table(["", *columns[:-2], "slowest, s", "CPU time, s"], rows)]
    if (folder / "mutants.json").exists():
        parts += mutants(json.loads((folder / "mutants.json").read_text()))
    return "\n".join(parts)


def mutants(record: dict) -> list[str]:
    """Return what became of mutants, module by module, and those that live."""
    heads = ["killed", "timeout", "survived", "not reached", "equivalent"]
    rows = [
        (f"`{name}`", *(found.get(head, 0) for head in heads)) for name, found in record["modules"].items()
    ]
    rows.append(("**all**", *(sum(row[place] for row in rows) for place in range(1, 6))))
    dead, tried = sum(rows[-1][1:3]), sum(rows[-1][1:5])
    parts = [MUTANTS.format(**record), table(["module", *heads], rows)]
    parts.append(
        f"Mutation score: **{dead} of {tried}** ({100 * dead / tried:.1f} %), equivalent ones aside.\n"
    )
    if record["survivors"]:
        parts.append("Survivors:\n\n" + "".join(f"- `{key}`\n" for key in record["survivors"]))
    if EQUIVALENT:
        lines = [f"- `{key}`: {reason}\n" for key, reason in sorted(EQUIVALENT.items())]
        parts.append("Equivalent: no test can tell these from the code, or should.\n\n" + "".join(lines))
    return parts


if __name__ == "__main__":
    (HERE / "quality.md").write_text(page(), encoding="utf-8")
