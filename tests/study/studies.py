"""Files of studies with made-up outcomes, for tests of what reads them."""

import numpy as np

from dynid.result import Variable
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.study.file import StudyHeading, write_study


def heading(columns, **more):
    count = len(next(iter(columns.values())))
    given = {
        "title": "Made up",
        "text": "dynid: 1\nkind: study\n",
        "base": "dynid: 1\n",
        "seed": 0,
        "numbers": np.arange(count),
        "columns": columns,
        "keys": np.arange(8 * count, dtype=np.uint8).reshape(count, 8),
    }
    return StudyHeading(**(given | more))


def write(path, columns, values, failed=(), expectations=None, complete=True, **more):
    """Write a study whose sample `row` has the scalars and arrays `values[path][row]`.

    What is given as (units, dims, {dim: labels}, rows) has axes.
    """
    count = len(next(iter(columns.values())))
    rows = [outcome(row, values, failed, expectations) for row in range(count)]
    write_study(path, heading(columns, **more), SampleOutcomes.of(rows).between, complete)


def outcome(row, values, failed, expectations):
    """Return one row; where its failure is None it is pending."""
    if row in failed:
        error = failed[row] if isinstance(failed, dict) else f"singular at {row}.5"
        return None if error is None else SampleOutcome(error=error, exit_code=3)
    found = {}
    for path, given in values.items():
        units, dims, axes, rows = given if isinstance(given, tuple) else ("", (), {}, given)
        found[path] = Variable(dims, kept(rows[row]), units)
        for dim, labels in axes.items():
            found[f"{path.rpartition('/')[0]}/{dim}"] = Variable((dim,), kept(labels))
    met = tuple(bool(column[row]) for column in expectations) if expectations else ()
    return SampleOutcome(found, expectations=met)


def kept(values):
    data = np.asarray(values)
    return data.astype(object) if data.dtype.kind == "U" else data
