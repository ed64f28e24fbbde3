"""Nastran OUTPUT2: nodes and labels of matrices by the tables of geometry."""

import struct
from pathlib import Path

import numpy as np
import pytest

from dynid.errors import DynidError, FileError
from dynid.files.read_structure import imported, model_files, read_nodes

pyyeti = pytest.importorskip("pyyeti", reason="pyyeti is not installed")
RUNS = Path(pyyeti.__file__).parent / "tests/nas2cam_extseout"

NODES = {7: (0.0, 0, 0), 3: (1.0, 0, 0), 12: (1.0, 2.0, 0), 5: (0.0, 2.0, 0.5), 20: (0.5, 1.0, 1.0)}
ASCENDING = sorted(NODES)
COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
G_SET = [f"{node}:{along}" for node in ASCENDING for along in COMPONENTS]


@pytest.mark.skipif(not RUNS.is_dir(), reason="pyyeti is installed without its test data")
@pytest.mark.parametrize("run", ["inboard", "inboard_v2007", "full"])
def test_nodes_are_those_of_the_bulk_data_of_the_same_run(tmp_path, run):
    """`inboard_v2007` has GRID entries alone, without BGPDT."""
    lines = (RUNS / f"{run}.dat").read_text().splitlines()
    included = [
        (RUNS / line.split("'")[1]).read_text() if line.upper().startswith("INCLUDE") else line
        for line in lines
    ]
    (tmp_path / "run.dat").write_text("\n".join(included))
    nodes, bulk = (read_nodes(path).nodes for path in (RUNS / f"{run}.op2", tmp_path / "run.dat"))
    assert set(nodes.numbers) == set(bulk.numbers)
    order = [bulk.places[node] for node in nodes.numbers]
    np.testing.assert_allclose(nodes.xyz, bulk.xyz[order], rtol=1e-6, atol=1e-5)
    for node in nodes.numbers:
        axes, expected = nodes.axes.get(node, np.eye(3)), bulk.axes.get(node, np.eye(3))
        np.testing.assert_allclose(axes, expected, atol=1e-6)


@pytest.mark.skipif(not RUNS.is_dir(), reason="pyyeti is installed without its test data")
def test_nodes_of_several_superelements_are_refused():
    with pytest.raises(FileError, match="has the nodes of 3 superelements"):
        read_nodes(RUNS / "assemble.op2")


def key(number):
    return struct.pack("<3i", 4, number, 4)


def record(content):
    size = struct.pack("<i", len(content))
    return key(len(content) // 4) + size + content + size


def block(name, trailer, kind, data):
    title = name.ljust(8).encode()
    ends = key(-2) + key(1) + key(0)
    return (
        record(title) + key(-1) + record(struct.pack("<7i", *trailer)) + ends
        + record(title) + key(-3) + key(1) + key(kind) + data + key(0)
    )  # fmt: skip


def table(name, *records):
    data = b"".join(
        (b"" if k == 0 else key(1) + key(0)) + record(content) + key(-4 - k)
        for k, content in enumerate(records)
    )
    return block(name, [101, *[0] * 6], 0, data + key(1) + key(0))


def matrix(name, values):
    rows, columns = values.shape
    data = b"".join(
        record(struct.pack(f"<i{rows}d", 1, *values[:, k])) + key(-4 - k) + key(1) + key(k < columns - 1)
        for k in range(columns)
    )
    return block(name, [101, columns, rows, 6, 2, 0, 0], 1, data)


def header():
    date = struct.pack("<3i", 11, 29, 26)
    return (
        key(3) + struct.pack("<i", 12) + date + struct.pack("<i", 12)
        + record(b"NASTRAN FORT TAPE ID CODE - ") + record(b"XXXXXXXX") + key(-1) + key(0)
    )  # fmt: skip


def geometry(external=()):
    grids = b"".join(struct.pack("<2i3f3i", node, 0, *NODES[node], 0, 0, 0) for node in NODES)
    records = [struct.pack("<3i", 4501, 45, 1) + grids]
    if external:
        pairs = b"".join(struct.pack("<2i", *pair) for pair in external)
        records.append(struct.pack("<3i", 1627, 16, 463) + pairs)
    return table("GEOM1", *records)


def internal_order():
    positions = b"".join(struct.pack("<i3f", 0, *NODES[node]) for node in ASCENDING)
    numbers = [(node, k + 1) for k, node in enumerate(ASCENDING)]
    dofs = [(node, 10 * (6 * k + 1) + 1) for k, node in enumerate(ASCENDING)]
    pairs = [b"".join(struct.pack("<2i", *pair) for pair in listed) for listed in (numbers, dofs)]
    return table("BGPDT", positions) + table("EQEXIN", *pairs)


def sets(held):
    from pyyeti.nastran.n2p import mkusetmask

    masks = [mkusetmask("s" if label in held else "b") for label in G_SET]
    return table("USET", struct.pack(f"<{len(masks)}I", *masks))


def stiffness():
    """A free chain of the nodes, by rigid-body motions of one end relative to the other."""
    K = np.zeros((len(G_SET), len(G_SET)))
    random = np.random.default_rng(3)
    for k in range(len(ASCENDING) - 1):
        x, y, z = np.subtract(NODES[ASCENDING[k + 1]], NODES[ASCENDING[k]])
        transfer = np.eye(6)
        transfer[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        relative = np.hstack([-transfer, np.eye(6)])
        root = random.standard_normal((6, 6)) + 3 * np.eye(6)
        at = slice(6 * k, 6 * k + 12)
        K[at, at] += relative.T @ root @ root.T @ relative
    return (K + K.T) / 2


HELD = [f"7:{along}" for along in COMPONENTS] + ["20:z"]
FREE = [k for k, label in enumerate(G_SET) if label not in HELD]
OUTSIDE = [(12, 123), (3, 456), (20, 1)]
OUTSIDE_LABELS = ["12:x", "12:y", "12:z", "3:rx", "3:ry", "3:rz", "20:x"]


@pytest.mark.parametrize(
    ("tables", "kept", "labels"),
    [
        (lambda: geometry() + internal_order() + sets(HELD), FREE, [G_SET[k] for k in FREE]),
        (lambda: geometry() + internal_order(), range(30), G_SET),
        (geometry, range(30), G_SET),
        (lambda: geometry(OUTSIDE), [G_SET.index(label) for label in OUTSIDE_LABELS], OUTSIDE_LABELS),
    ],
    ids=["sets", "internal order", "geometry alone", "external superelement"],
)
def test_matrices_have_labels_by_the_tables(tmp_path, tables, kept, labels):
    path = tmp_path / "model.op2"
    K = stiffness()[np.ix_(kept, kept)]
    path.write_bytes(header() + tables() + matrix("KXX", K) + matrix("MXX", np.eye(len(K))) + key(0))
    files = model_files(path)
    model = imported(files.mass, files.stiffness, nodes=files.nodes)
    assert list(model.dofs) == labels
    np.testing.assert_array_equal(model.K, K)
    assert model.nodes is not None
    assert dict(zip(model.nodes.numbers, map(tuple, model.nodes.xyz.tolist()), strict=True)) == NODES


def test_matrices_that_fit_no_table_are_refused(tmp_path):
    path = tmp_path / "model.op2"
    path.write_bytes(header() + geometry() + matrix("K", np.eye(11)) + matrix("M", np.eye(11)) + key(0))
    files = model_files(path)
    with pytest.raises(DynidError, match="11 DOFs, which is no order of DOFs of the 5 nodes"):
        imported(files.mass, files.stiffness, nodes=files.nodes)
