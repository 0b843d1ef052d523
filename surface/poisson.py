"""Smoothing by Poisson surface reconstruction, through MeshLab's library.

The paper names it (section 3.5) and leaves it out of its comparison. It closes what it covers but
promises no topology; `pymeshlab` (GPL-3) is installed beside the project, `pip install
'.[poisson]'`, and is imported only here.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from surface.mesh import SurfaceError, TriangleMesh

LEAST_DEPTH, MOST_DEPTH = 4, 12
"""Of the octree; at 9 its cells are about 4 mm for a person."""


def poisson_smoothed(mesh: TriangleMesh, depth: int) -> TriangleMesh:
    """A surface through a mesh's vertices and normals (Kazhdan and Hoppe, Screened Poisson Surface
    Reconstruction, TOG 2013).

    Args:
        mesh: closed and oriented.
        depth: of the octree.

    Returns:
        A mesh whose vertices have the colour of the nearest of the given. A person's is closed; of
        slivers and specks the library makes edges that are not.

    Raises:
        SurfaceError: the library gave up.
        ModuleNotFoundError: pymeshlab is not installed.
    """
    import pymeshlab

    work = pymeshlab.MeshSet(verbose=False)
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    try:
        work.generate_surface_reconstruction_screened_poisson(depth=depth, threads=1)
    except pymeshlab.PyMeshLabException as error:
        raise SurfaceError(f"Poisson reconstruction gave up ({error})") from None
    made = work.current_mesh()
    vertices = np.asarray(made.vertex_matrix(), dtype=np.float64)
    faces = np.asarray(made.face_matrix(), dtype=np.int64)
    colors = None
    if mesh.colors is not None:
        colors = mesh.colors[cKDTree(mesh.vertices).query(vertices)[1]]
    return TriangleMesh(vertices, faces, colors)
