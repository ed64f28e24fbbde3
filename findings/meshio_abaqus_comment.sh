#!/usr/bin/env bash
# meshio 5.3.5 and comments in Abaqus input files.
#
# A line that starts with ** is a comment, and may stand anywhere in an input file (Abaqus Keywords Reference).
# meshio takes it for the end of a block: elements behind a comment within *ELEMENT are dropped without a word.
# Seen: 1 of 2 tetrahedra, no warning. A node set that lists another set by name is empty, too.
#
# Installs the pinned package in a temporary folder; fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q --disable-pip-version-check meshio==5.3.5
cat > "$folder/mesh.inp" <<'INP'
*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
5, 1., 1., 1.
*NSET, NSET=base
1, 2, 3
*NSET, NSET=held
base, 4
*ELEMENT, TYPE=C3D4, ELSET=body
1, 1, 2, 3, 4
** the other one
2, 2, 3, 4, 5
INP
"$folder/env/bin/python" - "$folder/mesh.inp" <<'PY'
import sys
import warnings

import meshio

with warnings.catch_warnings(record=True) as said:
    warnings.simplefilter("always")
    mesh = meshio.read(sys.argv[1])
elements = sum(len(block.data) for block in mesh.cells)
print(f"elements: {elements} of 2; nodes of 'held': {len(mesh.point_sets['held'])} of 4; warnings: {len(said)}")
assert (elements, len(mesh.point_sets["held"]), len(said)) == (1, 0, 0), "meshio behaves differently now"
PY
