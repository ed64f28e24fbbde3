"""Write the matrices, eigenvalues and nodes of a space frame by OpenSeesPy (3.7.1), in the current folder."""

import json
from pathlib import Path

import openseespy.opensees as ops

XYZ = {1: (0, 0, 0), 2: (0, 0, 1.2), 3: (0.9, 0, 1.2), 4: (0.9, 0.7, 1.2), 5: (0.9, 0.7, 0.1)}


def analysis(mass, stiffness):
    """Assemble ``mass M + stiffness K`` with all its entries."""
    ops.wipeAnalysis()
    ops.constraints("Transformation")
    ops.numberer("Plain")
    ops.system("FullGeneral")
    ops.algorithm("Linear")
    ops.integrator("GimmeMCK", mass, 0.0, stiffness)
    ops.analysis("Transient")
    ops.analyze(1, 0.0)


def write(name):
    """Write the assembled matrix, row by row."""
    entries = ops.printA("-ret")
    n = round(len(entries) ** 0.5)
    rows = (" ".join(map(repr, entries[k * n : (k + 1) * n])) for k in range(n))
    Path(name).write_text("\n".join(rows) + "\n")


ops.wipe()
ops.model("basic", "-ndm", 3, "-ndf", 6)
for node, place in XYZ.items():
    ops.node(node, *map(float, place))
ops.fix(1, 1, 1, 1, 1, 1, 1)
ops.fix(5, 1, 1, 1, 0, 0, 0)
ops.geomTransf("Linear", 1, 1.0, 1.0, 0.3)
section = (4e-4, 2.1e11, 8e10, 3e-8, 2e-8, 1.5e-8)
for element in range(1, 5):
    ops.element("elasticBeamColumn", element, element, element + 1, *section, 1, "-mass", 3.14, "-cMass")
ops.constraints("Transformation")
ops.numberer("Plain")
ops.system("FullGeneral")
ops.algorithm("Linear")
eigenvalues = ops.eigen("-fullGenLapack", 10)
Path("frame_eigenvalues.json").write_text(json.dumps(eigenvalues))
analysis(0.0, 1.0)
write("frame_K.out")
analysis(1.0, 0.0)
write("frame_M.out")
free = {1: "-", 5: "rx ry rz"}
lines = [f"{n},{x},{y},{z},{free.get(n, 'x y z rx ry rz')}" for n, (x, y, z) in XYZ.items()]
Path("frame_nodes.csv").write_text("node,x,y,z,dofs\n" + "\n".join(lines) + "\n")
