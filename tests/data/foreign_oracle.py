"""Write `oracle.json`: what pyNastran 1.4 (with NumPy < 2) reads of its own test models.

``python foreign_oracle.py FOLDER``, where FOLDER/pynastran/models is pyNastran's folder `models`.
"""

import json
import sys
from pathlib import Path

import numpy as np
from pyNastran.bdf.bdf import BDF
from pyNastran.op4.op4 import OP4

FILES = [
    "elements/static_elements.bdf",
    "bwb/bwb_freq.bdf",
    "fsi/fsi.bdf",
    "msc/cantilever_2014.1.bdf",
    "bugs/msc_dscmcol/goland_final_test.bdf",
    "bugs/msc_RBE_tests/rigid_rbe2.bdf",
    "msc/cbush_2021/cbush_test.bdf",
    "aero/aerobeam.bdf",
    "bugs/euler_column_linear_buckling/euler_column_linear_buckling.bdf",
    "msc/contact/nsc01a_n.dat",
    "msc/64_bit/d173.bdf",
    "iSat/ISat_Dploy_Sm.dat",
    "iSat/ISat_Launch_Sm_Rgd.dat",
    "freq_sine/good_sine.dat",
    "complex/tet10/Simple_Example.bdf",
    "autodesk/9zk6b5uuo.bdf",
    "aero/freedlm/freedlm.bdf",
    "Satellite_V02/JOBS/QS/satellite_V02_ACA_QS_SOL101.dat",
]
OTHERS = ("elements", "properties", "masses", "materials", "loads", "constraints", "aero", "sets")


def nodes(path):
    """Return position and axes (rows; None: basic) by node; points of a fluid are left out."""
    model = BDF(debug=None)
    model.read_bdf(path, xref=False)
    skipped = {f"xref_{kind}": False for kind in (*OTHERS, "nodes_with_elements", "optimization")}
    model.cross_reference(**skipped)
    found = {}
    for number, node in model.nodes.items():
        if node.Cd() >= 0:
            axes = model.coords[node.Cd()].beta().tolist() if node.Cd() else None
            found[number] = [node.get_position().tolist(), axes]
    return found


def matrices(path):
    """Return shape, type and values (of large ones two sums) of the matrices by name."""
    found = {}
    for name, matrix in OP4(log=None).read_op4(path).items():
        data = matrix.data if hasattr(matrix, "data") else matrix[1]
        values = data.toarray() if hasattr(data, "toarray") else np.asarray(data)
        sums = [float(abs(values).sum()), float((values * np.arange(values.shape[1])).sum().real)]
        found[name] = [
            list(values.shape),
            str(values.dtype),
            values.real.tolist() if values.size < 1e4 else sums,
        ]
    return found


base = Path(sys.argv[1]) / "pynastran"
written = {
    "bdf": {f"models/{name}": nodes(str(base / "models" / name)) for name in FILES},
    "op4": {str(path.relative_to(base)): matrices(str(path)) for path in sorted(base.rglob("*.op4"))},
}
(base.parent / "oracle.json").write_text(json.dumps(written))
