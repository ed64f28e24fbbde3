"""Universal Files written through pyuff, for tests."""

import pytest


def written(path, *data_sets):
    """Write data sets to a Universal File, and return its path."""
    pyuff = pytest.importorskip("pyuff", reason="pyuff is an extra")
    path.unlink(missing_ok=True)
    for one in data_sets:
        pyuff.UFF(str(path)).write_sets(dict(one), "add")
    return path


def nodes(numbers, xyz, *, systems=0, defined=0, kind=15):
    """Return a data set of nodes (15 or 2411); `systems` are those of their displacements."""
    count = len(numbers)
    return {
        "type": kind,
        "node_nums": list(numbers),
        "def_cs": [defined] * count,
        "disp_cs": [systems] * count if isinstance(systems, int) else list(systems),
        "color": [1] * count,
        **{axis: [float(point[at]) for point in xyz] for at, axis in enumerate("xyz")},
    }


def system(number, origin, x, z, *, kind=0, reference=0):
    """Return a data set 18 of one coordinate system; x and z are directions in the reference system."""
    return {
        "type": 18,
        "cs_num": [number],
        "cs_type": [kind],
        "ref_cs_num": [reference],
        "color": [1],
        "method": [1],
        "cs_name": ["CS"],
        "ref_o": [list(origin)],
        "x_point": [[a + b for a, b in zip(origin, x, strict=True)]],
        "xz_point": [[a + b for a, b in zip(origin, z, strict=True)]],
    }


def units(length, force, code=9):
    """Return a record of units (164): how many units of the file are one metre, and one newton."""
    return {
        "type": 164,
        "units_code": code,
        "length": length,
        "force": force,
        "temp": 1.0,
        "temp_offset": 0.0,
    }


def mode(hertz, numbers, *columns, damping=0.0):
    """Return a data set 55 of a normal mode: a column for each direction of the nodes."""
    return {
        "type": 55,
        "model_type": 1,
        "analysis_type": 2,
        "data_ch": 2 if len(columns) == 3 else 3,
        "spec_data_type": 8,
        "data_type": 2,
        "n_data_per_node": len(columns),
        "load_case": 1,
        "mode_n": 1,
        "freq": hertz,
        "modal_m": 1.0,
        "modal_damp_vis": damping,
        "modal_damp_his": 0.0,
        "node_nums": list(numbers),
        **{f"r{k}": list(column) for k, column in enumerate(columns, 1)},
    }


def complex_mode(eigenvalue, numbers, *columns):
    """Return a data set 55 of a complex mode."""
    made = mode(0.0, numbers, *columns)
    for key in ("freq", "modal_m", "modal_damp_vis", "modal_damp_his"):
        del made[key]
    return made | {"analysis_type": 3, "data_type": 5, "eig": eigenvalue, "modal_a": 1j, "modal_b": 1j}


def function(values, *, kind=1, response=(1, 3), reference=(0, 0), step=0.01, start=0.0, **changes):
    """Return a data set 58: a function of evenly spaced abscissae between two DOFs, node and direction."""
    return {
        "type": 58,
        "binary": 0,
        "func_type": kind,
        "rsp_node": response[0],
        "rsp_dir": response[1],
        "ref_node": reference[0],
        "ref_dir": reference[1],
        "data": values,
        "x": [start + step * k for k in range(len(values))],
        "id1": "NONE",
        "rsp_ent_name": "NONE",
        "ref_ent_name": "NONE",
        "abscissa_spacing": 1,
        "abscissa_inc": step,
        "abscissa_min": start,
        "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": 12,
        "orddenom_spec_data_type": 0,
    } | changes
