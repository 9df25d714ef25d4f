"""A file of skills that cannot even be imported."""

from __future__ import annotations

raise NotImplementedError("on purpose, at import")
