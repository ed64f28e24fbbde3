"""Results as tables for other tools: CSV and Parquet, written in pieces, whole or not at all."""

from dynid.store.tables.grouped import tables_of
from dynid.store.tables.table import Field, Kind, Table, kind_of
from dynid.store.tables.write import write_csv, write_parquet

__all__ = ["Field", "Kind", "Table", "kind_of", "tables_of", "write_csv", "write_parquet"]
