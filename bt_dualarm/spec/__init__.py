"""Tree files: strict YAML, typed ports, checks of whole files, schema and reference.

Open first: `parser`.
"""
