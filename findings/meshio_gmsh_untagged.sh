#!/usr/bin/env bash
# meshio 5.3.5 and entities without a physical group in format 4.1 of gmsh.
#
# Format 4.1 lists the physical groups of an entity, of which there may be none (gmsh -save_all, Mesh.SaveAll).
# meshio collects tags only of entities that have some, and refuses the file where others have none:
# "Incompatible cell data 'gmsh:physical'. 2 cell blocks, but 'gmsh:physical' has 1 blocks."
# The same mesh in format 2.2, where such elements have the tag 0, is read.
#
# Installs the pinned package in a temporary folder; fails if the behaviour changes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q --disable-pip-version-check meshio==5.3.5
cat > "$folder/format41.msh" <<'MSH'
$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
1
3 7 "body"
$EndPhysicalNames
$Entities
0 0 1 1
1 0 0 0 1 1 0 0 0
1 0 0 0 1 1 1 1 7 0
$EndEntities
$Nodes
1 4 1 4
3 1 0 4
1
2
3
4
0 0 0
1 0 0
0 1 0
0 0 1
$EndNodes
$Elements
2 2 1 2
2 1 2 1
1 1 2 3
3 1 4 1
2 1 2 3 4
$EndElements
MSH
cat > "$folder/format22.msh" <<'MSH'
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 7 "body"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
2
1 2 2 0 1 1 2 3
2 4 2 7 1 1 2 3 4
$EndElements
MSH
"$folder/env/bin/python" - "$folder" <<'PY'
import sys

import meshio

mesh = meshio.read(f"{sys.argv[1]}/format22.msh")
print("format 2.2:", [(block.type, len(block.data)) for block in mesh.cells])
assert [block.type for block in mesh.cells] == ["triangle", "tetra"]
try:
    meshio.read(f"{sys.argv[1]}/format41.msh")
except Exception as error:
    print(f"format 4.1: {type(error).__name__}: {error}")
    assert "gmsh:physical" in str(error), "meshio behaves differently now"
else:
    sys.exit("meshio reads it now")
PY
