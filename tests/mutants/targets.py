"""What is mutated, and which tests hold it: the quick ones that say most about it."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
_SOURCE = ROOT / "src" / "dynid"

#: Modules of the reduction of bond graphs, and of the filter with its kernels' tables.
MODULES = {
    ".".join(("dynid", *path.relative_to(_SOURCE).with_suffix("").parts)): path
    for folder, pattern in [
        ("bondgraph/program", "program.py"),
        ("bondgraph/formulas", "*.py"),
        ("bondgraph/reduction", "*.py"),
        ("identification/estimators", "filter.py"),
        ("identification/systems", "kernels.py"),
    ]
    for path in sorted((_SOURCE / folder).glob(pattern))
    if path.stem != "__init__"
}

TESTS = [
    f"tests/{folder}/test_{name}.py"
    for folder, names in {
        "bondgraph": "activated_bonds bicausal compiled_plans compiled_response hidden_modes latex "
        "modelled_part port program published_graphs reduction regressions sensitivity snapshots "
        "state_equations stored_energy trace transfer_formulas transfer_properties",
        "identification": "filter kernels estimators sensitivities extreme_values diagnostics",
    }.items()
    for name in names.split()
]

#: Tests that take long here, and hold nothing that others do not.
LEFT_OUT = [
    f"tests/identification/test_{name}"
    for name in (
        "kernels.py::test_steps_made_now_and_then_serve_as_well_as_those_of_every_sample",
        "extreme_values.py::test_coloured_residuals_invalidate_the_channel_they_are_in_only",
    )
]
