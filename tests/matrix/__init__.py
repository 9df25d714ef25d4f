"""The interaction matrix: everything that can be done with a file, done to every kind of file."""

import pytest

pytest.register_assert_rewrite("tests.matrix.operations", "tests.matrix.recordings")
