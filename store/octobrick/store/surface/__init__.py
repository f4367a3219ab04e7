"""Surfaces in volumes: meshes, where they lie, and which cells they touch."""

from octobrick.store.surface.mesh import Mesh
from octobrick.store.surface.mesh_file import read_mesh
from octobrick.store.surface.placement import Placement

__all__ = ["Mesh", "Placement", "read_mesh"]
