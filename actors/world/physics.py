"""Physics of walls, robots and obstacles: motion and contacts."""

import math
import weakref
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from typing import Any, Final, NamedTuple

import numpy as np
import pymunk
from pymunk import batch
from pymunk._chipmunk import ffi, lib

from actors.array_types import Floats, Octets, UInt64s
from actors.geometry import Point, Pose, Twist
from actors.instant import START, Instant, in_seconds, milliseconds
from actors.portable import arrays, cos_sin
from actors.robot_model import Footprint, RobotModel, load_model
from actors.runtime.errors import AcrcError
from actors.world.drive import MEMORY, drive_forces, limits, moment_of_inertia, set_bumpers
from actors.world.people import SEPARATION, Pedestrians
from actors.world.social_force import MASS, RADIUS, count_contacts


class Shape(NamedTuple):
    """A rounded convex polygon: all points within `radius` of it. One vertex: a disc; two: a line."""

    vertices: Floats
    """Vertices, (n, 2), counter-clockwise, m in the map frame."""
    radius: float


def disc(x: float, y: float, radius: float) -> Shape:
    """Return a disc with this centre and radius, m."""
    return Shape(np.array([[x, y]]), radius)


def footprint_at(footprint: Footprint, pose: Pose) -> Shape:
    """Return a robot's footprint at a pose."""
    if footprint.radius is not None:
        return disc(pose.x, pose.y, footprint.radius)
    c, s = cos_sin(pose.heading)
    vertices = [(c * x - s * y + pose.x, s * x + c * y + pose.y) for x, y in footprint.vertices or ()]
    return Shape(np.array(vertices), 0.0)


def gap(a: Shape, b: Shape) -> float:
    """Return the shortest distance of two shapes, m; if they overlap, minus the penetration depth.

    The penetration depth of convex polygons is along the normal of one of their edges (separating axes:
    Gottschalk, Lin & Manocha, "OBBTree", SIGGRAPH 1996, for the plane).
    """
    radii = a.radius + b.radius
    depth = max(_separation(a.vertices, b.vertices), _separation(b.vertices, a.vertices))
    if depth <= 0 and max(len(a.vertices), len(b.vertices)) > 2:
        return depth - radii
    return min(_border_distance(a.vertices, b.vertices), _border_distance(b.vertices, a.vertices)) - radii


def wall_gap(shape: Shape, segments: Floats) -> float:
    """Return the smallest gap to wall segments (n, 4) within the shape's bounding box, m; inf without any."""
    low = shape.vertices.min(axis=0) - shape.radius
    high = shape.vertices.max(axis=0) + shape.radius
    ends = segments.reshape(-1, 2, 2)
    near = ((ends.max(axis=1) >= low) & (ends.min(axis=1) <= high)).all(axis=1)
    return smallest_gap(shape, (Shape(line, 0.0) for line in ends[near]))


def smallest_gap(shape: Shape, others: Iterable[Shape]) -> float:
    """Return the gap to the nearest other shape, m; inf without any."""
    return min((gap(shape, other) for other in others), default=math.inf)


def _separation(a: Floats, b: Floats) -> float:
    """Return the largest separation of b from a along a's edge normals; −inf if a is a point."""
    if len(a) == 1:
        return -math.inf
    edges = np.roll(a, -1, axis=0) - a
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / arrays.hypot(*edges.T)[:, None]
    reach = _products(a, normals)
    return float((_products(b[:, None], normals).min(axis=0) - reach).max())


def _border_distance(points: Floats, ring: Floats) -> float:
    """Return the distance from the nearest point to the border of the ring."""
    edges = np.roll(ring, -1, axis=0) - ring
    lengths = np.maximum(_products(edges, edges), np.finfo(float).tiny)
    offsets = points[:, None, :] - ring[None, :, :]
    along = np.clip(_products(offsets, edges) / lengths, 0.0, 1.0)
    away = offsets - along[:, :, None] * edges
    return float(np.sqrt(_products(away, away).min()))


def _products(a: Floats, b: Floats) -> Floats:
    """Return the inner products of plane vectors: (…, 2) and (…, 2) to (…), as numpy broadcasts them."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


_STATE: Final = (
    batch.BodyFields.POSITION
    | batch.BodyFields.ANGLE
    | batch.BodyFields.VELOCITY
    | batch.BodyFields.ANGULAR_VELOCITY
)
_FORCES: Final = batch.BodyFields.FORCE | batch.BodyFields.TORQUE
_CONTACTS: Final = (
    batch.ArbiterFields.BODY_A_ID
    | batch.ArbiterFields.BODY_B_ID
    | batch.ArbiterFields.IS_FIRST_CONTACT
    | batch.ArbiterFields.NORMAL
)
_BODY_READER: Final = ffi.addressof(lib, "pmSpaceBodyGetIteratorFuncBatched")
_BODY_WRITER: Final = ffi.addressof(lib, "pmSpaceBodySetIteratorFuncBatched")
_CONTACT_ITERATOR: Final = ffi.addressof(lib, "pmSpaceArbiterIteratorFuncBatched")


class BodyExchange:
    """Exchanges forces and states with the bodies of one space, in the order of their addition."""

    def __init__(self, space: pymunk.Space, forces: Floats) -> None:
        """Create an exchange; `forces`: (n + 1, 3), N, N, N m, read by `step`; the last row is the walls'."""
        self._space = space
        self._address = space._space
        self._force_buffer, self._state_buffer, self._contact_buffer = (batch.Buffer() for _ in range(3))
        self._force_buffer.set_float_buf(forces.reshape(-1))
        self._force_request = _request(_FORCES, self._force_buffer)
        self._state_request = _request(_STATE, self._state_buffer)
        self._contact_request = _request(_CONTACTS, self._contact_buffer)
        self._floats, self._states = self._force_buffer._float_arr, self._state_buffer._float_arr
        self._numbers, self._normals = self._contact_buffer._int_arr, self._contact_buffer._float_arr
        lib.cpSpaceEachBody(self._address, _BODY_READER, self._state_request)
        self.states: Floats = np.frombuffer(self._state_buffer.float_buf()).reshape(-1, 6)
        """x, y, heading, vx, vy, omega after the last `step`, (n + 1, 6); `step` overwrites it."""

    def step(self, dt: float, *, whole: bool) -> None:
        """Apply the forces for `dt`, s, and read the states.

        `whole`: include pymunk's bookkeeping of additions and removals since the last such step.
        """
        self._floats.num = 0  # read from the begin
        lib.cpSpaceEachBody(self._address, _BODY_WRITER, self._force_request)
        if whole:
            self._space.step(dt)
        else:
            lib.cpSpaceStep(self._address, dt)
        self._states.num = 0  # write from the begin
        lib.cpSpaceEachBody(self._address, _BODY_READER, self._state_request)

    def contacts(self) -> tuple[UInt64s, Floats] | None:
        """Return the contacts of the last sub-step; None without any. Valid until the next call.

        (m, 3): numbers of both bodies, and whether the contact is new; (m, 2): normals from first to second.
        """
        self._numbers.num = self._normals.num = 0
        lib.cpSpaceEachCachedArbiter(self._address, _CONTACT_ITERATOR, self._contact_request)
        if not self._numbers.num:
            return None
        pairs = np.frombuffer(self._contact_buffer.int_buf(), np.uint64).reshape(-1, 3)
        return pairs, np.frombuffer(self._contact_buffer.float_buf()).reshape(-1, 2)


def _request(fields: batch.BodyFields | batch.ArbiterFields, buffer: batch.Buffer) -> Any:
    """Return the request argument of the C functions."""
    data = ffi.new("pmBatchedData *")
    data.fields, data.floatArray, data.intArray = fields.value, buffer._float_arr, buffer._int_arr
    return data


_ANGLE: Final = 14
"""Index of the angle in a cpBody (Chipmunk 7, chipmunk_structs.h), in doubles."""
_ROTATION: Final = 17
"""Index of its transform: cosine, sine, minus sine, cosine, x, y."""


def use_portable_rotation(body: pymunk.Body) -> None:
    """Use portable functions for the rotation of the body's shapes whenever it moves."""
    _check_layout()
    body.position_func = _move_portably
    update_rotation(body)


def update_rotation(body: pymunk.Body) -> None:
    """Update the rotation of a body after its angle was set."""
    doubles = _doubles(body)
    c, s = cos_sin(doubles[_ANGLE])
    doubles[_ROTATION], doubles[_ROTATION + 1], doubles[_ROTATION + 2], doubles[_ROTATION + 3] = c, s, -s, c


def _move_portably(body: pymunk.Body, dt: float) -> None:
    pymunk.Body.update_position(body, dt)
    update_rotation(body)


def _doubles(body: pymunk.Body) -> Any:
    return ffi.cast("double *", body._body)


def _check_layout() -> None:
    """Assert that this release of pymunk has the memory layout that `update_rotation` writes to."""
    body = pymunk.Body(2.0, 3.0)
    body.position, body.angle = (7.0, 9.0), 0.5
    found = _doubles(body)
    c, s = cos_sin(0.5)
    expected = (c, s, -s, c, 7.0, 9.0)
    places = zip(range(_ROTATION, _ROTATION + 6), expected, strict=True)
    assert found[_ANGLE] == 0.5
    assert all(abs(found[place] - value) < 1e-12 for place, value in places)


SUBSTEP: Final = milliseconds(10)
"""Time step of the physics."""
_NO_CONTACTS: Final = np.empty((0, 3), np.uint64), np.empty((0, 2))


_SLOP_M: Final = 0.0005
"""Overlap that is not corrected, so that resting contacts persist; own choice."""
_CORRECTION: Final = 0.25
"""Share of the remaining overlap removed per sub-step; own choice: 5 % are left after 0.1 s."""
_ITERATIONS: Final = 20
"""Iterations of the contact solver per sub-step; own choice, for ten robots pushing into a door."""


class Arena:
    """Robots, by index, and people on one floor plan; advances in sub-steps of 10 ms.

    Equal calls give bit-equal states. A body without a process brakes and stays.
    """

    def __init__(
        self,
        segments: Floats,
        names: Sequence[str],
        models: Sequence[RobotModel],
        poses: Sequence[Pose],
        people: Pedestrians | None = None,
    ) -> None:
        """Create an arena; `segments`: (m, 4), x0, y0, x1, y1 of the walls, m.

        Raises AcrcError if a robot or person overlaps a wall, a robot or a person.
        """
        assert len(names) == len(models) == len(poses)
        n, starts = len(poses), people.starts if people is not None else ()
        self._people = people
        self._segments = segments
        self._names = (*names, *(f"person {number}" for number in range(1, len(starts) + 1)))
        self._models = tuple(models)
        self._obstacles: list[tuple[float, float, float]] = []
        self._doors: dict[int, tuple[Floats, list[pymunk.Shape]]] = {}
        self._space = _space(segments)
        weakref.finalize(self, _empty, self._space).atexit = False
        self._bodies = [_body(self._space, model, pose) for model, pose in zip(models, poses, strict=True)]
        persons = [_person(self._space, start) for start in starts]
        numbers = np.array([body.id for body in (*self._bodies, *persons)], np.uint64)
        self._order = np.argsort(numbers, kind="stable")
        self._numbers = numbers[self._order]
        self._limits = limits(models)
        self._commands = np.zeros((len(poses), 3))
        self._issued_us = np.zeros(len(poses), np.int64)
        self._delays_us = [round(model.drive.delay * 1e6) for model in models]
        self._delayed: list[tuple[int, int, Twist, Instant]] = []
        """Commands without effect so far: due time, µs, index, command and its instant, by order of issue."""
        self._memory = np.zeros(len(poses), MEMORY)
        forces = np.zeros((len(numbers) + 1, 3))  # pymunk counts the walls as one body
        self._forces, self._people_forces = forces[:n], forces[n:-1]
        self._radii = np.array(
            [*(model.footprint.circumradius for model in models), *(RADIUS for _ in starts)]
        )
        self._touching = np.zeros(len(poses), np.bool_)
        """True if each robot touches anything but robots, (n,)."""
        self._touched = False
        """True if any robot does."""
        self._exchange = BodyExchange(self._space, forces)
        self._state, self._whole = self._exchange.states[:n], self._exchange.states[:-1]
        assert np.array_equal(self._state[:, :3], np.array(poses).reshape(-1, 3))
        self._touched_us = np.full((len(starts), n), -SEPARATION - 1, np.int64)
        self.now: Instant = START
        """Instant of the states."""
        self.bumpers: Octets = np.zeros(len(poses), np.uint8)
        """Bumper bits pressed during the last `advance`, (n,); bit 0 right, 1 centre, 2 left."""
        self.contacts = 0
        """Contacts begun so far, between two robots or a robot and a static body."""
        self.people_contacts = 0
        """Contacts begun so far between a robot and a person."""
        self.people_contact_us = 0
        """Total duration of these contacts, µs."""
        self._check_overlaps()
        self._tell_people()

    def __len__(self) -> int:
        return len(self._models)

    @property
    def poses(self) -> Floats:
        """x, y in m, heading in rad in (−π, π], map frame, (n, 3)."""
        return _wrapped(self._state[:, :3])

    @property
    def velocities(self) -> Floats:
        """vx, vy in m/s, map frame, and omega in rad/s, (n, 3)."""
        return self._state[:, 3:].copy()

    @property
    def people(self) -> Floats:
        """x, y, m, and vx, vy, m/s, of all people, map frame, (p, 4)."""
        return self._whole[len(self) :, [0, 1, 3, 4]]

    @property
    def obstacles(self) -> Floats:
        """x, y, radius of the round obstacles, m, (m, 3)."""
        return np.array(self._obstacles, dtype=np.float64).reshape(-1, 3)

    @property
    def discs(self) -> Floats:
        """x, y, radius of the round obstacles and of all people, m, (m, 3)."""
        people = np.column_stack([self.people[:, :2], self._radii[len(self) :]])
        return np.concatenate([self.obstacles, people])

    def command(self, index: int, twist: Twist, instant: Instant) -> None:
        """Set a robot's velocity command; the drive's watchdog expires relative to `instant`."""
        vx, vy, omega = twist  # comparisons, as this is called often
        if not (-math.inf < vx < math.inf and -math.inf < vy < math.inf and -math.inf < omega < math.inf):
            raise AcrcError(
                f"{self._names[index]} commands {twist.vx}, {twist.vy} m/s and {twist.omega} rad/s; "
                "velocities must be finite"
            )
        if delay := self._delays_us[index]:
            self._delayed.append((instant + delay, index, twist, instant))
        else:
            self._commands[index], self._issued_us[index] = twist, instant

    def _apply_delayed(self) -> None:
        """Apply the delayed commands that are due."""
        for due, index, twist, instant in self._delayed:
            if due <= self.now:
                self._commands[index], self._issued_us[index] = twist, instant
        self._delayed = [one for one in self._delayed if one[0] > self.now]

    def advance(self, substeps: int = 1) -> Floats:
        """Advance; return the poses after every sub-step, (substeps, n, 3)."""
        track = np.empty((substeps, len(self), 3))
        dt = in_seconds(SUBSTEP)
        self.bumpers[:] = 0
        for k in range(substeps):
            if self._delayed:
                self._apply_delayed()
            orders = self._commands, self._issued_us, self.now
            drive_forces(self._state, *orders, dt, self._limits, self._memory, self._forces)
            if self._people is not None:
                self._people.drive(self._whole, self._radii, self.now, dt, self._people_forces)
            self._exchange.step(dt, whole=k == 0)
            contacts = self._exchange.contacts()
            if contacts is not None or self._touched:
                pairs, normals = contacts or _NO_CONTACTS
                robots = self._numbers, self._order, self._limits
                begun, self._touched = set_bumpers(
                    self._state, pairs, normals, *robots, self.bumpers, self._touching
                )
                self.contacts += begun
                if self._people is not None:
                    self._count_people_contacts(pairs)
            self.now = Instant(self.now + SUBSTEP)
            track[k] = self._state[:, :3]
        return _wrapped(track)

    def _count_people_contacts(self, pairs: UInt64s) -> None:
        known = self._numbers, self._order, len(self)
        begun, touching = count_contacts(pairs, *known, self.now, SEPARATION, self._touched_us)
        self.people_contacts += begun
        self.people_contact_us += touching * SUBSTEP

    def move(self, index: int, pose: Pose) -> None:
        """Relocate a robot's body, at rest. Raises AcrcError if it would overlap anything."""
        shape = footprint_at(self._models[index].footprint, pose)
        if obstruction := self._obstruction(shape, [j for j in range(len(self._names)) if j != index]):
            raise AcrcError(
                f"{self._names[index]} does not fit at ({pose.x:g}, {pose.y:g}): "
                f"it would overlap {obstruction}"
            )
        body = self._bodies[index]
        body.position, body.angle = (pose.x, pose.y), pose.heading
        body.velocity, body.angular_velocity = (0.0, 0.0), 0.0
        if self._models[index].footprint.radius is None:
            update_rotation(body)
        self._space.reindex_shapes_for_body(body)
        self._state[index] = (*pose, 0.0, 0.0, 0.0)
        self._memory[index] = 0.0

    def add_obstacle(self, centre: Point, radius: float) -> None:
        """Add a permanent round obstacle. Raises AcrcError as `check_obstacle`."""
        self.check_obstacle(centre, radius)
        self._obstacles.append((centre.x, centre.y, radius))
        self._space.add(_static(pymunk.Circle(self._space.static_body, radius, centre)))
        self._tell_people()

    def check_obstacle(self, centre: Point, radius: float) -> None:
        """Raise AcrcError for a round obstacle that is not finite or would overlap a robot or person."""
        if not (0 < radius < 100 and math.isfinite(centre.x) and math.isfinite(centre.y)):
            raise AcrcError(
                f"an obstacle at ({centre.x:g}, {centre.y:g}) has a radius of {radius:g} m; "
                "its coordinates must be finite, its radius between 0 and 100 m"
            )
        for name, shape in zip(self._names, self._shapes(), strict=True):
            if gap(shape, disc(*centre, radius)) < 0:
                raise AcrcError(
                    f"an obstacle of {radius:g} m does not fit at ({centre.x:g}, {centre.y:g}): "
                    f"it would overlap {name}"
                )

    def is_obstructed(self, segments: Floats) -> bool:
        """Return whether a robot or person stands on a door of these segments, (n, 4)."""
        return any(wall_gap(shape, segments) < 0 for shape in self._shapes())

    def close_door(self, door: int, segments: Floats) -> None:
        """Add the segments of a door; none may obstruct them."""
        ends = [((x0, y0), (x1, y1)) for x0, y0, x1, y1 in segments.tolist()]
        shapes = [_static(pymunk.Segment(self._space.static_body, *line, 0.0)) for line in ends]
        self._space.add(*shapes)
        self._doors[door] = segments, shapes
        self._tell_people()

    def open_door(self, door: int) -> None:
        """Remove the segments of a closed door."""
        _, shapes = self._doors.pop(door)
        self._space.remove(*shapes)
        self._tell_people()

    def _tell_people(self) -> None:
        """Update what people find on the floor beside the map's walls."""
        if self._people is not None:
            walls = self._walls
            self._people.set_floor(walls, self.obstacles, walls[len(self._segments) :])

    @property
    def _walls(self) -> Floats:
        """Segments of the floor plan and of closed doors, (n, 4)."""
        return np.concatenate([self._segments, *(segments for segments, _ in self._doors.values())])

    def _shapes(self) -> Iterator[Shape]:
        return map(self._shape, range(len(self._names)))

    def _shape(self, index: int) -> Shape:
        pose = Pose(*self._whole[index, :3].tolist())
        robot = index < len(self)
        return footprint_at(self._models[index].footprint, pose) if robot else disc(pose.x, pose.y, RADIUS)

    def _obstruction(self, shape: Shape, others: Sequence[int]) -> str:
        """Return what `shape` overlaps: "a wall", "an obstacle", a robot's or person's name, or ""."""
        if wall_gap(shape, self._walls) < 0:
            return "a wall"
        if smallest_gap(shape, (disc(*obstacle) for obstacle in self._obstacles)) < 0:
            return "an obstacle"
        offsets, spread = self._whole[:, :2] - shape.vertices[0], shape.vertices - shape.vertices[0]
        reach = self._radii + shape.radius + np.sqrt(_products(spread, spread).max()) + 1e-6
        near = _products(offsets, offsets) < reach * reach
        return next((self._names[j] for j in others if near[j] and gap(shape, self._shape(j)) < 0), "")

    def _check_overlaps(self) -> None:
        for index, shape in enumerate(self._shapes()):
            if obstruction := self._obstruction(shape, range(index)):
                x, y = self._whole[index, :2].tolist()
                raise AcrcError(
                    f"{self._names[index]} does not fit at ({x:g}, {y:g}): it would overlap {obstruction}"
                )


def _space(segments: Floats) -> pymunk.Space:
    space = pymunk.Space()
    space.iterations = _ITERATIONS
    space.collision_slop = _SLOP_M
    # pymunk's collision_bias is the share of an overlap left after 1 s; it derives the share per sub-step
    # with the C library's power function. Correctly rounded, our value is so close to an exact power that the
    # result lies within 0.1 ulp of the float that we need: every C library finds it.
    space.collision_bias = float(Fraction(1 - _CORRECTION) ** (1_000_000 // SUBSTEP))
    space.collision_persistence = 1  # so that pymunk returns only contacts of this sub-step
    for x0, y0, x1, y1 in segments.tolist():
        space.add(_static(pymunk.Segment(space.static_body, (x0, y0), (x1, y1), 0.0)))
    return space


def _empty(space: pymunk.Space) -> None:
    """Empty a space that is no longer used; freeing a full one may crash (viblo/pymunk, issue 209)."""
    space.remove(*space.shapes, *space.bodies)


def _static(shape: pymunk.Shape) -> pymunk.Shape:
    """Set the friction of a static shape so that a contact has that of the robot's model."""
    shape.friction = 1.0
    return shape


def _body(space: pymunk.Space, model: RobotModel, pose: Pose) -> pymunk.Body:
    body = pymunk.Body(model.mass, moment_of_inertia(model))
    body.position, body.angle = (pose.x, pose.y), pose.heading
    shape: pymunk.Shape
    if model.footprint.radius is not None:
        shape = pymunk.Circle(body, model.footprint.radius)
    else:
        shape = pymunk.Poly(body, model.footprint.vertices or ())
        use_portable_rotation(body)
    shape.friction = model.friction
    space.add(body, shape)
    return body


def _person(space: pymunk.Space, at: Point) -> pymunk.Body:
    """Add a person, who slides along others and walls."""
    body = pymunk.Body(MASS, math.inf)
    body.position = (at.x, at.y)
    shape = pymunk.Circle(body, RADIUS)
    shape.friction = 0.0
    space.add(body, shape)
    return body


def _wrapped(poses: Floats) -> Floats:
    """Return a copy with headings in (−π, π]."""
    copy = poses.copy()
    copy[..., 2] = np.pi - np.mod(np.pi - copy[..., 2], 2 * np.pi)
    return copy


def fingerprint() -> bytes:
    """Return the result of a simulation with contacts, which differs if a processor computes differently."""
    wall = np.array([[0.5, -2.0, 0.55, 2.0]])
    turtlebot, omnibox = load_model("turtlebot2"), load_model("omnibox")
    models, names = [turtlebot, omnibox, turtlebot], ["r1", "r2", "r3"]
    arena = Arena(wall, names, models, [Pose(-0.8, 0.05, 0.1), Pose(-0.3, 0.0, 0.4), Pose(0.2, -0.1, 0.2)])
    for index in range(3):
        arena.command(index, Twist(0.5, 0.0, 0.3), START)
    poses = arena.advance(100)
    assert arena.contacts
    return poses.tobytes() + arena.velocities.tobytes()
