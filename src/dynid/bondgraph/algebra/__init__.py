"""The number types that a reduction's program is run on, beside complex arrays."""
