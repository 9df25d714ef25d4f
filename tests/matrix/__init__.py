"""The interaction matrix: every operation on a tree file, applied to every type of tree file."""

import pytest

pytest.register_assert_rewrite("tests.matrix.operations", "tests.matrix.recordings")
