"""Recordings are read in a separate process, which a damaged file cannot leave."""

import numpy as np
import pytest

from dynid.errors import FileError
from tests.files import recorder_files
from tests.files.reading import read_columns

pytestmark = pytest.mark.thorough


def test_a_damaged_mf4_file_is_refused_and_a_sound_one_is_read(tmp_path):
    values = np.sin(np.arange(50.0))
    path = recorder_files.mf4(tmp_path / "r.mf4", 0.1 * np.arange(50), {"acc": (values, "g", 0.5)})
    np.testing.assert_array_equal(read_columns(path, ["acc"], step=0.1)[:, 0], values)
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(FileError, match="cannot be read as a measurement data file"):
        read_columns(path, ["acc"], step=0.1)
