"""Results to and from HDF5 files, whole or not at all."""

from dynid.store.files import read_result, write_result

__all__ = ["read_result", "write_result"]
