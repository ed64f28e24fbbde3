"""Tell the coverage of branches by package, from `coverage json -o -`; fail where it is too little."""

import json
import sys
from collections import Counter, defaultdict
from pathlib import PurePosixPath

#: Per cent of the branches that must be covered: of everything, and of what reads and writes users' files.
#: The store is covered whole; the margin is for what processes that tests kill could not tell any more.
#: Of the scenes some thirty branches are not: labels of expectations, studies that fall back to single runs.
LEAST = {"all": 95.0, "scene": 99.0, "store": 99.5}


def main() -> int:
    """Print the table, and return the exit code."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for file, data in json.load(sys.stdin)["files"].items():
        parts = PurePosixPath(file).parts
        below = parts[parts.index("dynid") + 1 :]
        for package in ("all", below[0] if len(below) > 1 else "(ground floor)"):
            found[package].update(
                {key: value for key, value in data["summary"].items() if type(value) is int}
            )
    failed = False
    print(f"{'package':<16} {'lines':>8} {'branches':>9} {'missing':>8}")
    for package, sums in sorted(found.items()):
        lines = 100 * sums["covered_lines"] / max(sums["num_statements"], 1)
        branches = 100 * sums["covered_branches"] / max(sums["num_branches"], 1)
        short = branches < LEAST.get(package, 0.0)
        failed |= short
        note = f"  below {LEAST[package]:g} %" if short else ""
        print(f"{package:<16} {lines:>6.2f} % {branches:>7.2f} % {sums['missing_branches']:>8}{note}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
