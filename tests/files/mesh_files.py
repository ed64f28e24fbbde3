"""Meshes in text, and meshes that refer to other files."""

import h5py
import numpy as np

ABAQUS = """\
*HEADING
free text, 1, 2
** a comment
*Node, nset=first
 101, 0.0, 0.0, 0.0
** a comment among the nodes
   7, 1.0, 0.0, 0.0
*NODE
33, 0., 1., 0.
4, 0., 0., 1.
5, 1., 1., 1.
*ELEMENT, TYPE=C3D8
*Element, type=c3d4,
  elset=Body
1, 101, 7, 33, 4
** a comment among the elements
2, 7, 33, 4, 5
*ELEMENT, TYPE=S3, ELSET=skin
12, 7, 33, 5
*NSET, NSET=pair
101, 7,
*NSET, NSET=more, GENERATE
4, 5, 1
*NSET, NSET=all
pair, more
*NSET, NSET=Pair
33
*ELSET, ELSET=both
body
*ELSET, ELSET=both
12
*ELSET, ELSET=second, GENERATE
2, 2
"""


def referring(folder, form):
    """Write a mesh that refers to another file, and return its name and that of the other file."""
    folder.mkdir(exist_ok=True)
    if form == "abaqus":
        (folder / "m.inp").write_text(ABAQUS.split("*Element")[0] + "*INCLUDE, INPUT=parts/rest.txt\n")
        name = "m.inp"
        rest = "*Element" + ABAQUS.split("*Element")[1]
    elif form == "abaqus nodes":
        (folder / "m.inp").write_text("*NODE, INPUT=parts/rest.txt\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n")
        name, rest = "m.inp", "1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n"
    elif form == "nastran":
        (folder / "m.bdf").write_text("INCLUDE 'parts/rest.txt'\nCTETRA,1,1,1,2,3,4\n")
        name, rest = "m.bdf", "GRID,1\nGRID,2,,1.\nGRID,3,,0.,1.\nGRID,4,,0.,0.,1.\n"
    else:
        (folder / "parts").mkdir(exist_ok=True)
        with h5py.File(folder / "parts" / "rest.txt", "w") as store:
            store["data0"] = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
            store["data1"] = np.array([[0, 1, 2, 3]])
        (folder / "m.xdmf").write_text(
            '<Xdmf Version="3.0"><Domain><Grid Name="Grid"><Geometry GeometryType="XYZ"><DataItem '
            'DataType="Float" Dimensions="4 3" Format="HDF" Precision="8">parts/rest.txt:/data0</DataItem>'
            '</Geometry><Topology TopologyType="Tetrahedron" NumberOfElements="1" NodesPerElement="4">'
            "<DataItem "
            'DataType="Int" Dimensions="1 4" Format="HDF" Precision="8">parts/rest.txt:/data1</DataItem>'
            "</Topology></Grid></Domain></Xdmf>"
        )
        return "m.xdmf", "parts/rest.txt"
    (folder / "parts").mkdir(exist_ok=True)
    (folder / "parts" / "rest.txt").write_text(rest)
    return name, "parts/rest.txt"
