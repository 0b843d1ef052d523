"""A surface on disk: OBJ, PLY, glTF and STL files read into a `Mesh`; see `read_mesh`."""

from subjects.meshfile.reader import EXTENSIONS, read_mesh, read_mesh_and_files
from subjects.meshfile.texture import read_texture
from subjects.meshfile.winding import check_winding

__all__ = ["EXTENSIONS", "check_winding", "read_mesh", "read_mesh_and_files", "read_texture"]
