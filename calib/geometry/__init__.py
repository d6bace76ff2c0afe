"""Solids, the distances between them, and what stands in the way.

The solids are those that robots are made of. What is computed with them is in
:mod:`calib.geometry.scene`; meshes are read by
:mod:`calib.robots.description.mesh_file`.
"""

from calib.geometry.scene import Scene as Scene
from calib.robots.shapes import Body as Body
from calib.robots.shapes import Box as Box
from calib.robots.shapes import Capsule as Capsule
from calib.robots.shapes import Cylinder as Cylinder
from calib.robots.shapes import HalfSpace as HalfSpace
from calib.robots.shapes import LinkShape as LinkShape
from calib.robots.shapes import Mesh as Mesh
from calib.robots.shapes import Solid as Solid
from calib.robots.shapes import Sphere as Sphere
