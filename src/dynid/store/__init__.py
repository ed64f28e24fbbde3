"""Results to and from HDF5 files, whole or not at all."""

from dynid.store.files import hollow, loaded, open_stored, read_result, write_blocks, write_result

__all__ = ["hollow", "loaded", "open_stored", "read_result", "write_blocks", "write_result"]
