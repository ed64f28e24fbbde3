"""Write docs/licences.md: `python docs/licences.py`, in an environment with the extras.

Licences are what the packages say of themselves. A licence in the core that is not known to leave users
free is an error.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

HERE = Path(__file__).parent
PROJECT = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["project"]
#: What a licence of the core may be made of. LGPL is not among it: see `LIBRARIES`.
FREE = re.compile(r"0BSD|BSD|MIT|MIT-CMU|Apache|PSF|Python Software Foundation|ISC|Zlib|CC0|HPND")
#: Copyleft that the core may hold, and why: it is that of a library apart, which users may replace.
LIBRARIES = {"python-flint": "LGPL-3.0-or-later"}
#: What packages do not say of themselves, from their licence files.
UNSAID = {"atheris": "Apache-2.0", "axe-playwright-python": "MIT; axe-core in it MPL-2.0"}
TEXT = """\
# Licences of dependencies

Written by `python docs/licences.py` from the metadata of the packages. dynid is MIT. No core dependency
is under the GPL or AGPL; a test checks the installed versions.

## The core

All packages that `pip install dynid` installs, including indirect dependencies.

{core}

Wheels also contain libraries. Those with other licences than the packages:

| wheel | library | licence | so that |
|---|---|---|---|
| python-flint | FLINT, GMP, MPFR | LGPL-3.0-or-later | they are linked dynamically, can be replaced, and \
their licences are in the wheel |
| numpy, scipy | libgfortran | GPL-3.0-or-later WITH GCC-exception-3.1 | the exception \
lets any program use it |
| numpy, scipy | libquadmath | LGPL-2.1-or-later | linked dynamically, can be replaced |

## Extras

Asked for by name, `pip install dynid[formats]`; `fuzz`, `docs` and `test` are for work on dynid itself.

{extras}

pypardiso brings Intel's MKL, which is not free software (Intel Simplified Software License): it is used
only where it is installed, and never by default.
"""


def core() -> dict[str, set[str]]:
    """Return the packages of the core, and what asks for each."""
    asked: dict[str, set[str]] = {}
    waiting = [("dynid", text) for text in PROJECT["dependencies"]]
    while waiting:
        by, text = waiting.pop()
        wanted = Requirement(text)
        if wanted.marker and not wanted.marker.evaluate({"extra": ""}):
            continue
        name = canonicalize_name(wanted.name)
        if name not in asked:
            waiting += [(name, each) for each in requires(name) or []]
        asked.setdefault(name, set()).add(by)
    return dict(sorted(asked.items()))


def licence(name: str) -> str:
    """Return what a package says of its licence, in a few words."""
    said = metadata(name)
    classes = [c.split(" :: ")[-1] for c in said.get_all("Classifier") or [] if c.startswith("License")]
    texts = [said.get("License-Expression"), said.get("License")]
    short = [text for text in texts if text and len(text) < 80]  # some give the licence itself
    return UNSAID.get(name) or next(iter(short or classes), "not said")


def is_free(name: str) -> bool:
    """Tell whether every part of a package's licence leaves users free."""
    parts = re.split(r" AND | OR ", licence(name))
    return all(FREE.match(part) or part == LIBRARIES.get(name) for part in parts)


def table(head: str, rows: Iterable[tuple[str, ...]]) -> str:
    """Return a table of Markdown."""
    rule = "|---" * (head.count("|") - 1) + "|"
    return "\n".join([head, rule, *("| " + " | ".join(row) + " |" for row in rows)])


def extras() -> Iterable[tuple[str, str, str]]:
    """Yield extra, package and licence, of what is asked for directly."""
    for extra, texts in PROJECT["optional-dependencies"].items():
        for name in (canonicalize_name(Requirement(text).name) for text in texts):
            if name == "dynid":
                continue
            try:
                yield f"`{extra}`", name, licence(name)
            except PackageNotFoundError:
                sys.exit(f"{name} of the extra '{extra}' is not installed here")


def main() -> int:
    """Write the page; return 1 if there is a licence in the core that binds users."""
    asked = core()
    rows = [(name, licence(name), ", ".join(sorted(by))) for name, by in asked.items()]
    page = TEXT.format(
        core=table("| package | licence | asked for by |", rows),
        extras=table("| extra | package | licence |", extras()),
    )
    (HERE / "licences.md").write_text(page)
    bound = [f"{name}: {licence(name)}" for name in asked if not is_free(name)]
    print(*bound, sep="\n", end="\n" if bound else "")
    return int(bool(bound))


if __name__ == "__main__":
    sys.exit(main())
