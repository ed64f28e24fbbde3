"""Meshes of boxes by hand: hexahedra, and the tetrahedra and wedges that they split into."""

import numpy as np

from dynid.structure.solid_elements import ELEMENTS
from dynid.structure.solid_mesh import Block, SolidMesh

# Corners of the parts of a hexahedron.
PARTS = {
    "tetra": [(0, 1, 3, 7), (0, 1, 7, 4), (1, 2, 3, 7), (1, 2, 7, 6), (1, 4, 5, 7), (1, 5, 6, 7)],
    "wedge": [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)],
    "hexahedron": [tuple(range(8))],
}


def box(kind, counts, size=(1.0, 1.0, 1.0), move=lambda xyz: xyz):
    """A box of a kind of elements, `counts` hexahedra along each side, moved; its faces are sets."""
    base = next(name for name in ("tetra", "wedge", "hexahedron") if kind.startswith(name))
    nx, ny, nz = counts
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    at = np.arange(len(grid)).reshape(nx + 1, ny + 1, nz + 1)
    corners = np.stack([
        at[i : nx + i, j : ny + j, k : nz + k].ravel()
        for i, j, k in ELEMENTS["hexahedron"].corners.astype(int)
    ], axis=1)  # fmt: skip
    straight = [grid[corners[:, part]].astype(float) for part in PARTS[base]]
    element = ELEMENTS[kind]
    linear = ELEMENTS[base].shapes(element.nodes)
    points = np.concatenate([linear @ one for one in straight])
    places, cells = np.unique(np.round(points.reshape(-1, 3) * 4).astype(int), axis=0, return_inverse=True)
    xyz = places / 4 * np.array(size) / np.array(counts)
    ends = {
        f"{name}{end}": np.flatnonzero(places[:, axis] == 4 * counts[axis] * end)
        for axis, name in enumerate("xyz")
        for end in (0, 1)
    }
    blocks = (Block(kind, cells.reshape(len(points), -1)),)
    return SolidMesh(tuple(range(1, len(xyz) + 1)), move(xyz), blocks, {}, ends)


def joined_meshes(one, other, groups=("one", "other")):
    """Both meshes beside each other, no node shared."""
    cells = tuple(Block(block.kind, block.cells + len(one.xyz)) for block in other.blocks)
    blocks = (*one.blocks, *cells)
    members = {
        name: tuple(np.arange(len(block.cells) if (place < len(one.blocks)) == (name == groups[0]) else 0)
                    for place, block in enumerate(blocks))
        for name in groups
    }  # fmt: skip
    xyz = np.vstack([one.xyz, other.xyz])
    return SolidMesh(tuple(range(1, len(xyz) + 1)), xyz, blocks, members, {})
