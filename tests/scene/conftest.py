"""What several tests of scenes need."""

from tests.identification.conftest import _estimates_alone, complete  # noqa: F401 - fixtures
