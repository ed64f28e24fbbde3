"""Results to and from HDF5 files, whole or not at all."""

from dynid.store.files import open_stored, read_result, write_result

__all__ = ["open_stored", "read_result", "write_result"]
