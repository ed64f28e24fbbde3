"""Graphs written for other programs, as scenes."""

from dynid.scene.netlists.bondgraphtools import read_netlist

__all__ = ["read_netlist"]
