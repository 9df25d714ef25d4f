"""The tracking experiments: which there are, one run of one, what it measured, and the report."""
