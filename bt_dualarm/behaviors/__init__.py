"""Node types of the tree language, loading of tree files, and trees that tick.

Open first: `language`.
"""
