"""Renders a world from any pose: colour and depth in one pass, without a display.

Faces, patterns and light never change and are uploaded once; each frame only lists the faces that may be in view,
nearest first, and the people.
"""

from __future__ import annotations

import functools
import importlib
import math
import os
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.errors import MissingExtra
from waychair.install_advice import install_command
from waychair.simulation.plan.world import World
from waychair.simulation.scene.moving import sides_of
from waychair.simulation.scene.scene import Block, Mover, OtherChair
from waychair.simulation.sensors.figures import body_meshes
from waychair.simulation.sensors.light_map import LightMap, default_lamps, light_map
from waychair.simulation.sensors.looks import GLASS, GLASS_OPACITY, LOOKS, look_table
from waychair.simulation.sensors.shaders import FRAGMENT_SHADER, VERTEX_SHADER, with_laser
from waychair.simulation.sensors.surfaces import Surfaces, surfaces_from_world
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, IntArray, Pose3

NEAR = 0.1
"""Near plane [m]: nothing nearer is drawn."""

PERSON_REACH = 1.3
"""Radius [m] of the sphere round the point at 1 m height that contains a person."""

_NAMES = tuple(LOOKS)
_QUAD = np.array([0, 1, 2, 0, 2, 3], np.uint32)
_LAYOUT = "3f4 2f4 2f4 1f4 1u4 1u4"
_VERTEX = np.dtype(
    [
        ("position", "f4", 3),
        ("on_surface", "f4", 2),
        ("on_light_map", "f4", 2),
        ("shade", "f4"),
        ("seed", "u4"),
        ("look", "u4"),
    ]
)
_Vertices: TypeAlias = NDArray[np.void]


@dataclass(frozen=True, slots=True)
class RenderedImage:
    """A rendered image; the arrays belong to the renderer and are valid until it renders again.

    `colour` (H, W, 4) u8: square roots of the exposed light in red, green and blue, and the part of its light that
    returns to a depth camera. `depth` (H, W) f32 [m] along the optical axis, +inf where there is nothing.
    """

    colour: Bytes
    depth: Float32Array


LASER_COLUMNS = 2048
"""Directions in a laser's fan whose first surface is looked up: finer than the columns of a picture."""

LASER_REACH = math.tan(math.radians(30.0))
"""Tangent of half the angle of a laser's fan."""


@dataclass(frozen=True, slots=True)
class Laser:
    """A laser whose fan lies in the x and z axes of its frame, z in the middle; `power` [m²] is its light times area:
    a line of this many square metres would be lit as by an office's lamps.
    """

    map_from_laser: Pose3
    power: float


@functools.cache
def renderer_problem() -> str | None:
    """Return why this machine cannot render, with the remedy; None if it can. The check runs only once."""
    try:
        _context().release()
    except MissingExtra as error:
        return str(error)
    return None


def camera_matrix(width: int, height: int, field_of_view: float) -> FloatArray:
    """Return the matrix (3, 3) [pixels] of a camera without distortion with horizontal `field_of_view` [rad].

    Pixel coordinates are those of pixel centres.
    """
    focal = width / 2 / math.tan(field_of_view / 2)
    return np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])


class Renderer:
    """Renders one world; holds its graphics data and the buffers of the images."""

    def __init__(
        self, world: World, camera_matrix: FloatArray, width: int, height: int, *, draws_laser: bool = False
    ) -> None:
        """`camera_matrix` (3, 3) [pixels], without skew. A world without lamps gets the light of an office.

        `draws_laser`: `render` can draw a laser's line.

        Raises:
            MissingExtra: moderngl or EGL is missing; the message says how to get it.
        """
        self.leaves: tuple[Block, ...] = ()
        """Leaves of the level's lifts as they are now."""
        self._context = _context()
        self._close = weakref.finalize(self, self._context.release)
        self.camera_matrix = camera_matrix
        self._projection = _projection(camera_matrix, width, height)
        self._colour = np.zeros((height, width, 4), np.uint8)
        self._depth = np.zeros((height, width), np.float32)
        world = world if world.lamps else replace(world, lamps=default_lamps(world))
        surfaces = surfaces_from_world(world, _NAMES)
        glowing = surfaces.looks == _NAMES.index("lamp")
        light = light_map(surfaces, glowing, world.blocks, world.lamps, world.finish)
        vertices = np.zeros((len(surfaces.seeds), 4), _VERTEX)
        vertices["position"] = surfaces.corners
        vertices["on_surface"] = surfaces.outlines
        vertices["on_light_map"] = light.coordinates
        vertices["shade"] = 1.0
        vertices["seed"] = surfaces.seeds[:, None]
        vertices["look"] = surfaces.looks[:, None]
        self._bounds = _Bounds.of(surfaces)
        self._floor = _Floor.of(surfaces, light)
        with self._context:
            self._upload(vertices, light.texels, draws_laser)

    def _upload(self, vertices: _Vertices, light: Float32Array, draws_laser: bool) -> None:
        """Upload the constant data and make the buffers for the images."""
        height, width = self._depth.shape
        context = self._context
        shaders = VERTEX_SHADER, FRAGMENT_SHADER
        vertex, fragment = (with_laser(each) for each in shaders) if draws_laser else shaders
        self._program = context.program(vertex_shader=vertex, fragment_shader=fragment)
        self._fan = _Fan.of(context, self._program) if draws_laser else None
        self._uniform("looks").write(look_table())
        self._light = context.texture(light.shape[1::-1], 3, light.astype(np.float16), dtype="f2", alignment=1)
        self._target = context.framebuffer(
            [context.texture((width, height), 4)], context.depth_texture((width, height))
        )
        self._indices = context.buffer(reserve=4 * _QUAD.size * max(len(vertices), 1))
        self._faces = self._vertex_array(context.buffer(vertices), self._indices)

    def render(
        self,
        map_from_camera: Pose3,
        people: Sequence[Mover] = (),
        exposure: float = 0.3,
        laser: Laser | None = None,
    ) -> RenderedImage:
        """Return the image from a pose of the optical frame (REP-103: z forward, x right, y down) at an exposure.

        A laser's line is drawn where nothing stands before it, if the renderer `draws_laser`.
        """
        with self._context as context:
            self._light.use(0)
            context.enable_only(context.DEPTH_TEST)
            if self._fan is not None:
                self._aim_fan(self._fan, people, laser)
            self._uniform("exposure").value = exposure
            glass = self._draw(self._target, self._projection, map_from_camera, people)
            if len(glass):
                self._draw_glass(glass)
            self._target.read_into(self._colour, components=4)
            self._target.read_into(self._depth, components=1, attachment=-1, dtype="f4")
        metres_from_depth(self._depth)
        return RenderedImage(self._colour, self._depth)

    def _aim_fan(self, fan: _Fan, people: Sequence[Mover], laser: Laser | None) -> None:
        """Find the first surface in each direction of a laser's fan, as a picture of one row from the laser's place."""
        self._uniform("laser_power").value = 0.0
        self._uniform("laser_from_map").write(np.eye(4, dtype=np.float32))
        if laser is None:
            return
        self._draw(fan.target, fan.projection, laser.map_from_laser, people)
        fan.target.read_into(fan.depth, components=1, attachment=-1, dtype="f4")
        metres_from_depth(fan.depth)
        fan.texture.write(np.minimum(fan.depth, np.float32(1e6)))
        fan.texture.use(1)
        self._uniform("laser_power").value = laser.power
        laser_from_map = _matrix(laser.map_from_laser.inverse())
        self._uniform("laser_from_map").write(laser_from_map.T.astype(np.float32, order="C"))

    def _draw(self, target: Any, projection: FloatArray, map_from_camera: Pose3, people: Sequence[Mover]) -> IntArray:
        """Draw all that is opaque; return the faces of glass in view, from far to near."""
        clip_from_map = projection @ _matrix(map_from_camera.inverse())
        solid, glass = self._bounds.in_view(clip_from_map, map_from_camera.translation)
        middles = np.array([(p.pose.x, p.pose.y, 1.0) for p in people]).reshape(-1, 3)
        seen_people = list(
            compress(people, _in_frustum(clip_from_map, middles, np.array([_reach(p) for p in people], np.float64)))
        )
        target.use()
        target.clear(0.0, 0.0, 0.0, 0.0, depth=1.0)
        self._uniform("clip_from_map").write(clip_from_map.T.astype(np.float32, order="C"))
        self._uniform("opacity").value = 1.0
        if seen_people:
            self._draw_people(seen_people)
        if self.leaves:
            self._draw_leaves(self.leaves)
        self._draw_faces(solid)
        return glass

    def release(self) -> None:
        """Free the graphics data; nothing can be rendered afterwards."""
        self._close()

    def _draw_faces(self, faces: IntArray) -> None:
        if len(faces):
            self._indices.write((faces[:, None] * 4 + _QUAD).astype(np.uint32))
            self._faces.render(vertices=len(faces) * _QUAD.size)

    def _draw_glass(self, faces: IntArray) -> None:
        """Draw glass from far to near, blended over the image and without depth: depth cameras see through it."""
        context = self._context
        if self._fan is not None:
            self._uniform("laser_power").value = 0.0  # the line goes through
        context.enable(context.BLEND)
        context.blend_func = context.SRC_ALPHA, context.ONE_MINUS_SRC_ALPHA, context.ZERO, context.ONE_MINUS_SRC_ALPHA
        self._uniform("opacity").value = GLASS_OPACITY
        self._target.depth_mask = False
        self._draw_faces(faces)
        self._target.depth_mask = True

    def _draw_people(self, people: Sequence[Mover]) -> None:
        """Draw people in the light on the floor below them, darker on faces that look down."""
        bodies = body_meshes(people, _NAMES)
        vertices = np.zeros(len(bodies.looks), _VERTEX)
        vertices["position"] = bodies.positions
        vertices["on_surface"] = bodies.on_surface
        vertices["on_light_map"] = np.array([self._floor.at(p.pose.x, p.pose.y) for p in people])[bodies.owners]
        vertices["shade"] = 0.75 + 0.25 * bodies.upward
        vertices["seed"] = bodies.seeds
        vertices["look"] = bodies.looks
        self._context.enable(self._context.CULL_FACE)
        self._draw_once(vertices, bodies.triangles)
        self._context.disable(self._context.CULL_FACE)

    def _draw_leaves(self, leaves: Sequence[Block]) -> None:
        """Draw the sides of leaves in the light on the floor below them."""
        sides = sides_of(leaves)
        owners = np.arange(len(leaves)).repeat(4)
        high = np.array([leaf.high for leaf in leaves])[owners]
        lengths = np.hypot(*(sides[:, 2:] - sides[:, :2]).T)
        vertices = np.zeros((len(sides), 4), _VERTEX)
        ends = sides.reshape(-1, 2, 2)[:, [0, 1, 1, 0]]
        vertices["position"][..., :2] = ends
        vertices["position"][:, 2:, 2] = high[:, None]
        vertices["on_surface"][:, 1:3, 0] = lengths[:, None]
        vertices["on_surface"][:, 2:, 1] = high[:, None]
        lit = np.array([self._floor.at(leaf.middle.x, leaf.middle.y) for leaf in leaves])
        vertices["on_light_map"] = lit[owners][:, None]
        vertices["shade"] = 0.9
        vertices["seed"] = np.array([leaf.seed for leaf in leaves])[owners][:, None]
        vertices["look"] = np.array([_NAMES.index(leaf.material) for leaf in leaves])[owners][:, None]
        self._draw_once(vertices, np.arange(len(sides))[:, None] * 4 + _QUAD)

    def _draw_once(self, vertices: Any, triangles: IntArray) -> None:
        """Draw what has moved since the last picture; its buffers are not kept."""
        points = self._context.buffer(vertices)
        corners = self._context.buffer(triangles.astype(np.uint32))
        array = self._vertex_array(points, corners)
        array.render()
        for part in (array, points, corners):
            part.release()

    def _vertex_array(self, vertices: Any, indices: Any) -> Any:
        return self._context.vertex_array(
            self._program, [(vertices, _LAYOUT, *(_VERTEX.names or ()))], index_buffer=indices
        )

    def _uniform(self, name: str) -> Any:
        return self._program[name]


@dataclass(frozen=True, slots=True)
class _Fan:
    """A laser's fan: the picture of one row from its place, with its projection (4, 4), and the texture of its depth."""

    target: Any
    projection: FloatArray
    depth: Float32Array
    texture: Any

    @classmethod
    def of(cls, context: Any, program: Any) -> _Fan:
        size = LASER_COLUMNS, 1
        matrix = camera_matrix(LASER_COLUMNS, 1, 2 * math.atan(LASER_REACH))
        texture = context.texture(size, 1, dtype="f4")
        texture.filter = context.NEAREST, context.NEAREST
        program["light_map"].value, program["laser_depth"].value = 0, 1
        program["laser_reach"].value = LASER_REACH
        target = context.framebuffer([context.texture(size, 4)], context.depth_texture(size))
        return cls(target, _projection(matrix, *size), np.zeros((1, LASER_COLUMNS), np.float32), texture)


@dataclass(frozen=True, slots=True)
class _Bounds:
    """Where the faces lie: normals (N, 3), offsets of their planes (N,) [m], and spheres round them [m, map].

    `is_glass` (N,) marks panes.
    """

    normals: FloatArray
    offsets: FloatArray
    middles: FloatArray
    radii: FloatArray
    is_glass: BoolArray

    @classmethod
    def of(cls, surfaces: Surfaces) -> _Bounds:
        middles = surfaces.corners.mean(axis=1)
        return cls(
            normals=surfaces.normals,
            offsets=np.sum(surfaces.normals * surfaces.anchors, axis=1),
            middles=middles,
            radii=np.linalg.norm(surfaces.corners - middles[:, None], axis=2).max(axis=1),
            is_glass=surfaces.looks == _NAMES.index(GLASS),
        )

    def in_view(self, clip_from_map: FloatArray, camera: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the faces that may be in view: opaque from near to far, to draw few pixels twice, and glass."""
        facing = self.normals @ camera > self.offsets
        seen = np.flatnonzero(facing & _in_frustum(clip_from_map, self.middles, self.radii))
        distances = np.linalg.norm(self.middles[seen] - camera, axis=1) - self.radii[seen]
        seen = seen[np.argsort(distances, kind="stable")]
        is_glass = self.is_glass[seen]
        return seen[~is_glass], seen[is_glass][::-1]


@dataclass(frozen=True, slots=True)
class _Floor:
    """The pieces of the floor: least and greatest x, y (K, 2) [m, map] and the light map's coordinates of both."""

    low: FloatArray
    high: FloatArray
    light_low: FloatArray
    light_high: FloatArray

    @classmethod
    def of(cls, surfaces: Surfaces, light: LightMap) -> _Floor:
        pieces = (surfaces.corners[..., 2] == 0.0).all(axis=1) & (surfaces.normals[:, 2] > 0.9)
        corners, coordinates = surfaces.corners[pieces, :, :2], light.coordinates[pieces].astype(np.float64)
        return cls(corners.min(axis=1), corners.max(axis=1), coordinates.min(axis=1), coordinates.max(axis=1))

    def at(self, x: float, y: float) -> FloatArray:
        """Return the light map's coordinates (2,) of the floor at this point, or at the nearest point of the floor."""
        nearest = np.clip((x, y), self.low, self.high)
        k = int(np.argmin(np.hypot(*(nearest - (x, y)).T)))
        part = (nearest[k] - self.low[k]) / (self.high[k] - self.low[k])
        place: FloatArray = self.light_low[k] + part * (self.light_high[k] - self.light_low[k])
        return place


@njit(cache=True, nogil=True)
def metres_from_depth(depth: Float32Array) -> None:
    """Convert a depth buffer (H, W), 1 - near / z, into z [m] in place; 1, where nothing was drawn, becomes +inf."""
    height, width = depth.shape
    for row in range(height):
        for column in range(width):
            rest = np.float32(1.0) - depth[row, column]
            depth[row, column] = np.float32(NEAR) / rest if rest > 0.0 else np.float32(np.inf)


def _context() -> Any:
    """Return a new graphics context without a window.

    Raises:
        MissingExtra: moderngl is not installed, or the machine has no EGL.
    """
    # Mesa's software renderer needs less processor time per frame in one thread; it reads this at its start.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    try:
        moderngl: Any = importlib.import_module("moderngl")
    except ImportError as error:
        raise MissingExtra(f"the camera needs moderngl ({error}): {install_command('sim')}") from error
    try:
        return moderngl.create_context(standalone=True, backend="egl")
    except Exception as error:  # the exception's type depends on the missing library
        raise MissingExtra(
            f"the camera needs OpenGL through EGL ({error}): install it, on Debian apt install libegl1 libgl1-mesa-dri"
        ) from error


def _projection(camera_matrix: FloatArray, width: int, height: int) -> FloatArray:
    """Return the matrix (4, 4) from optical frame to clip coordinates, without a far plane, with the first row on top.

    Depth in the buffer is 1 - near / z (Lengyel, Projection Matrix Tricks, 2007, with the far plane at infinity).
    """
    (fx, _, cx), (_, fy, cy), _ = camera_matrix
    # OpenGL measures pixels from their corner, the camera matrix from their centre.
    return np.array(
        [
            [2 * fx / width, 0.0, 2 * (cx + 0.5) / width - 1.0, 0.0],
            [0.0, 2 * fy / height, 2 * (cy + 0.5) / height - 1.0, 0.0],
            [0.0, 0.0, 1.0, -2 * NEAR],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )


def _reach(mover: Mover) -> float:
    """Return the radius [m] of the sphere round the point at 1 m height that contains a person or a chair."""
    if not isinstance(mover, OtherChair):
        return PERSON_REACH
    return math.hypot(mover.body.circumscribed_radius, 1.0)


def _in_frustum(clip_from_map: FloatArray, middles: FloatArray, radii: FloatArray) -> BoolArray:
    """Return whether spheres with middles (N, 3) [m, map] reach into the view frustum, between its four sides, (N,)."""
    planes = np.concatenate([clip_from_map[3] + clip_from_map[:2], clip_from_map[3] - clip_from_map[:2]])
    planes = planes / np.linalg.norm(planes[:, :3], axis=1)[:, None]
    ahead: BoolArray = np.all(middles @ planes[:, :3].T + planes[:, 3] > -radii[:, None], axis=1)
    return ahead


def _matrix(pose: Pose3) -> FloatArray:
    """Return a pose as a homogeneous matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix
