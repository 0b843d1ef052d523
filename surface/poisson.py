"""Smoothing by Poisson surface reconstruction, through MeshLab's library.

The paper names it (section 3.5) and leaves it out of its comparison. It closes what it covers but
promises no topology; `pymeshlab` (GPL-3) is installed beside the project, `pip install
'.[poisson]'`, and is imported only here.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from surface.mesh import TriangleMesh

DEPTH = 9
"""Of the octree: cells of about 4 mm for a person."""


def poisson_smoothed(mesh: TriangleMesh, depth: int = DEPTH) -> TriangleMesh:
    """A surface through a mesh's vertices and normals (Kazhdan and Hoppe, Screened Poisson Surface
    Reconstruction, TOG 2013).

    Args:
        mesh: closed and oriented.
        depth: of the octree, 4 to 12.

    Returns:
        A closed mesh; each vertex has the colour of the nearest one of the given.

    Raises:
        ValueError: depth is out of bounds.
        ModuleNotFoundError: pymeshlab is not installed.
    """
    if not 4 <= depth <= 12:
        raise ValueError(f"poisson: {depth}; give the octree's depth, 4 to 12, such as {DEPTH}")
    import pymeshlab

    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.generate_surface_reconstruction_screened_poisson(depth=depth, threads=1)
    made = work.current_mesh()
    vertices = np.asarray(made.vertex_matrix(), dtype=np.float64)
    faces = np.asarray(made.face_matrix(), dtype=np.int64)
    colors = None
    if mesh.colors is not None:
        colors = mesh.colors[cKDTree(mesh.vertices).query(vertices)[1]]
    return TriangleMesh(vertices, faces, colors)
