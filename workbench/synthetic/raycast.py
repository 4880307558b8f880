"""Exact rays against the analytic part: compiled kernels, no mesh.

In the part's frame a point has the coordinates (u, h, z): u names the normal plane of the lower edge that holds it, h
is its distance from the edge's plan curve, outwards, z its height. In a normal plane, which is the section plane at u,
the part is the polygon that the recipe asks for, so root face and bevel angle hold exactly, drifting or not. The body
is {F <= 0}, F the maximum over its faces; Newton's method on F along a ray, from outside, finds the entry. What a
milling tool has left of the part is one more face: a height over the plane of the bevel, on a grid.
"""

from __future__ import annotations

import math
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from workbench.geometry.blocks import in_order
from workbench.kernels import kernel
from workbench.units import AnyArray, Float, Shaped

Vector: TypeAlias = tuple[float, float, float]  # tuples stay in registers, small arrays would be allocated
CourseTerms: TypeAlias = tuple[float, float, float, float, float]

STRAIGHT, ARC, WAVY = range(3)
NOTHING, ROOT, BEVEL, UPPER, LOWER, END, CLAMP, TABLE = range(8)

_ON_FACE_MM = 1e-9
_OFFSET_MM = 0.02  # shadow rays start this far off the surface
OUTREACH_MM = 15.0  # rays are followed from this far in front of the end face
CUT_REACH_MM = 3.0  # `CutTerms.relax` holds for steps up to this
_EVEN = 0.952  # a greater `CutTerms.relax` speaks of a cut face with slopes below 0.03: there Newton's steps are good
_DAMPED = 0.95
FRAMES_A_CALL = 16  # to each core in turn


class CutTerms(NamedTuple):
    """What a milling tool has left: heights over a bevel plane in each section plane, on a grid over u and w.

    w runs up the plane from the end face; between the grid's points the height is bilinear, beyond them it stays.
    """

    height: Shaped[Float, "U W"]  # along the plane's outward normal; (0, 0): nothing was cut
    u_step: float  # column i lies at u = i u_step
    w_first: float
    w_step: float
    root: float  # the plane meets the end face here
    cosine: float  # of the bevel angle
    sine: float
    relax: Shaped[Float, " U"]  # share of the height over the cut face that is a safe step, up to `CUT_REACH_MM`


UNCUT = CutTerms(np.zeros((0, 0)), 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, np.zeros(0))


class Surface(NamedTuple):
    """The part as the kernels see it. A course is (value at 0, slope per mm, amplitude, wave number, phase)."""

    bend: int
    curvature: float  # 1/mm; positive: centre on the plate's side (convex)
    wave_amplitude: float
    wave_number: float
    wave_phase: float
    length: float
    width: float
    tilt: float  # rad, of the end face at u = 0, outwards towards its upper side
    tilt_cos: float
    tilt_sin: float
    twist: float  # rad/mm: the tilt rises by it along u
    milled: bool
    thickness: CourseTerms
    root: CourseTerms
    bevel: CourseTerms  # rad
    roughness: Shaped[Float, "c 4"]  # amplitude, wave numbers along and across, phase
    rough_reach: float  # no part of the roughness goes further
    burrs: Shaped[Float, "b 5"]  # upper (1) or lower (0), from, to, height, width
    top: float  # greatest height
    relax: float  # 0: Newton steps; else the share of F that is a safe step (rough or burred parts)
    reserve: float  # F - reserve is a safe step too, from far off
    cut: CutTerms = UNCUT


class Sensor(NamedTuple):
    """The scanner in its own frame {P}: emitter at (emitter_x, 0, emitter_z), camera `baseline` further along y."""

    sign: float  # +1: z counts away from the sensor
    emitter_x: float
    emitter_z: float
    baseline: float
    near: float
    far: float
    fan: bool
    angular: bool
    cos_min: float


@kernel
def course(c: CourseTerms, u: float) -> tuple[float, float]:
    """Value at u, and its slope."""
    value, slope = c[0] + c[1] * u, c[1]
    if c[2] != 0.0:
        angle = c[3] * u + c[4]
        value += c[2] * math.sin(angle)
        slope += c[2] * c[3] * math.cos(angle)
    return value, slope


@kernel
def lean(s: Surface, u: float) -> tuple[float, float]:
    """Cosine and sine of the end face's tilt at u."""
    if s.twist == 0.0:
        return s.tilt_cos, s.tilt_sin
    return math.cos(s.tilt + s.twist * u), math.sin(s.tilt + s.twist * u)


@kernel
def edge_point(s: Surface, u: float) -> tuple[float, float, float, float]:
    """Plan position x, y of the lower edge at u, and its unit tangent."""
    if s.bend == ARC:
        angle = u * s.curvature
        return math.sin(angle) / s.curvature, (1.0 - math.cos(angle)) / s.curvature, math.cos(angle), math.sin(angle)
    if s.bend == WAVY:
        angle = s.wave_number * u + s.wave_phase
        rise = s.wave_amplitude * (math.sin(angle) - math.sin(s.wave_phase))
        steep = s.wave_amplitude * s.wave_number * math.cos(angle)
        stretch = math.sqrt(1.0 + steep * steep)
        return u, rise, 1.0 / stretch, steep / stretch
    return u, 0.0, 1.0, 0.0


@kernel
def project(s: Surface, x: float, y: float) -> tuple[float, float, float, float, float]:
    """u and h of a plan point, the tangent at u, and the length that a unit of u has at that h."""
    if s.bend == ARC:
        radius = 1.0 / s.curvature
        side = 1.0 if radius > 0.0 else -1.0
        angle = math.atan2(side * x, side * (radius - y))
        h = side * math.hypot(x, radius - y) - radius
        return angle * radius, h, math.cos(angle), math.sin(angle), 1.0 + h * s.curvature
    if s.bend == WAVY:
        return _project_wave(s, x, y)
    return x, -y, 1.0, 0.0, 1.0


@kernel
def _project_wave(s: Surface, x: float, y: float) -> tuple[float, float, float, float, float]:
    a, k = s.wave_amplitude, s.wave_number
    offset = a * math.sin(s.wave_phase)
    u, rise, steep, bend = x, 0.0, 0.0, 0.0
    for _ in range(30):
        sine, cosine = math.sin(k * u + s.wave_phase), math.cos(k * u + s.wave_phase)
        rise, steep, bend = a * sine - offset, a * k * cosine, -a * k * k * sine
        slope = 1.0 + steep * steep - (y - rise) * bend
        step = ((x - u) + (y - rise) * steep) / max(slope, 0.2)
        u += step
        if abs(step) < 1e-12 * (1.0 + abs(u)):
            break
    stretch = math.sqrt(1.0 + steep * steep)
    tx, ty = 1.0 / stretch, steep / stretch
    h = (x - u) * ty - (y - rise) * tx
    return u, h, tx, ty, max(stretch * (1.0 + h * bend / stretch**3), 0.2)


@kernel
def _rough(s: Surface, u: float, v: float) -> tuple[float, float, float]:
    height, along, across = 0.0, 0.0, 0.0
    for i in range(s.roughness.shape[0]):
        a, ku, kv, phase = s.roughness[i]
        sine, cosine = math.sin(ku * u + kv * v + phase), math.cos(ku * u + kv * v + phase)
        height += a * cosine
        along -= a * ku * sine
        across -= a * kv * sine
    return height, along, across


@kernel
def _ridge(s: Surface, upper: int, u: float, q: float) -> tuple[float, float, float]:
    """Height of the burrs on one edge at distance q from it, and its slopes along u and q."""
    height, along, across = 0.0, 0.0, 0.0
    for i in range(s.burrs.shape[0]):
        side, start, stop, peak, width = s.burrs[i]
        if side != upper or u <= start or u >= stop:
            continue
        w = math.pi / (stop - start)
        sine, cosine = math.sin(w * (u - start)), math.cos(w * (u - start))
        bell = peak * math.exp(-((q / width) ** 2))
        height += sine * sine * bell
        along += 2.0 * w * sine * cosine * bell
        across -= 2.0 * q / (width * width) * sine * sine * bell
    return height, along, across


@kernel
def _cut(c: CutTerms, u: float, g: float, v: float) -> tuple[float, float, float, float]:
    """Height over what the tool has left, and its derivatives by u, g and v (distances from and along the end face)."""
    across = c.cosine * (v - c.root) - c.sine * g
    i, j = min(max(u / c.u_step, 0.0), c.height.shape[0] - 1.0), (across - c.w_first) / c.w_step
    inside = 0.0 < j < c.height.shape[1] - 1.0
    j = min(max(j, 0.0), c.height.shape[1] - 1.0)
    row, column = min(int(i), c.height.shape[0] - 2), min(int(j), c.height.shape[1] - 2)
    p, q = i - row, j - column
    a, b = c.height[row, column], c.height[row, column + 1]
    a_next, b_next = c.height[row + 1, column], c.height[row + 1, column + 1]
    along = ((1.0 - q) * (a_next - a) + q * (b_next - b)) / c.u_step
    up = ((1.0 - p) * (b - a) + p * (b_next - a_next)) / c.w_step if inside else 0.0
    left = (1.0 - p) * ((1.0 - q) * a + q * b) + p * ((1.0 - q) * a_next + q * b_next)
    return c.cosine * g + c.sine * (v - c.root) - left, -along, c.cosine + up * c.sine, c.sine - up * c.cosine


@kernel
def body(s: Surface, u: float, h: float, z: float) -> tuple[float, int, float, float, float]:
    """F at a point, the face that F comes from, and F's derivatives by u, h and z."""
    thick, thick_u = course(s.thickness, u)
    tilt_cos, tilt_sin = lean(s, u)
    g, v = h * tilt_cos - z * tilt_sin, z * tilt_cos + h * tilt_sin
    g_u, v_u = -v * s.twist, g * s.twist
    best, face, fu, fh, fz = -z, LOWER, 0.0, 0.0, -1.0
    root, root_u, sine, cosine, bevel_u = 0.0, 0.0, 0.0, 1.0, 0.0
    if s.milled:
        root, root_u = course(s.root, u)
        angle, bevel_u = course(s.bevel, u)
        sine, cosine = math.sin(angle), math.cos(angle)
        f = cosine * g + sine * (v - root)
        if f > best:
            best, face = f, BEVEL
            fu = bevel_u * (cosine * (v - root) - sine * g) - sine * root_u + cosine * g_u + sine * v_u
            fh, fz = cosine * tilt_cos + sine * tilt_sin, sine * tilt_cos - cosine * tilt_sin
    if s.cut.height.shape[0] > 0:
        f, f_u, f_g, f_v = _cut(s.cut, u, g, v)
        if f > best:
            best, face, fu = f, BEVEL, f_u + f_g * g_u + f_v * v_u
            fh, fz = f_g * tilt_cos + f_v * tilt_sin, f_v * tilt_cos - f_g * tilt_sin
    bump, bump_u, bump_q = 0.0, 0.0, 0.0
    if s.burrs.shape[0] > 0:
        along_bevel = cosine * tilt_cos + sine * tilt_sin
        corner = (root * sine - thick * (sine * tilt_cos - cosine * tilt_sin)) / along_bevel
        bump, bump_u, bump_q = _ridge(s, 1, u, h - corner)
    if z - thick - bump > best:
        best, face, fu, fh, fz = z - thick - bump, UPPER, -thick_u - bump_u, -bump_q, 1.0
    bump, bump_u, bump_q = 0.0, 0.0, 0.0
    if s.relax > 0.0 and g + s.rough_reach > best:
        burr, burr_u, burr_q = _ridge(s, 0, u, v)
        rough, rough_u, rough_q = _rough(s, u, v)
        bump, bump_u, bump_q = burr + rough, burr_u + rough_u, burr_q + rough_q
    if g - bump > best:
        best, face, fu = g - bump, ROOT, g_u - bump_u - bump_q * v_u
        fh, fz = tilt_cos - bump_q * tilt_sin, -tilt_sin - bump_q * tilt_cos
    if -u > best:
        best, face, fu, fh, fz = -u, END, -1.0, 0.0, 0.0
    if u - s.length > best:
        best, face, fu, fh, fz = u - s.length, END, 1.0, 0.0, 0.0
    if -h - s.width > best:
        best, face, fu, fh, fz = -h - s.width, END, 0.0, -1.0, 0.0
    return best, face, fu, fh, fz


@kernel
def _along(p: Vector, d: Vector, a: float) -> Vector:
    return p[0] + a * d[0], p[1] + a * d[1], p[2] + a * d[2]


@kernel
def _prism(s: Surface, near: Float, o: Vector, d: Vector, lo: float, hi: float) -> tuple[float, float]:
    """The stretch of a ray in which it can meet the plate: below its top, above its bottom, close to its end face."""
    along = d[0] * near[2] + d[1] * near[3]
    gap = (o[0] - near[0]) * near[2] + (o[1] - near[1]) * near[3] - OUTREACH_MM
    for rate, value in ((along, gap), (d[2], o[2] - s.top - 1.0), (-d[2], -o[2] - 1.0)):
        if abs(rate) < 1e-15:
            if value > 0.0:
                return 1.0, 0.0
        elif rate < 0.0:
            lo = max(lo, -value / rate)
        else:
            hi = min(hi, -value / rate)
    return lo, hi


@kernel
def _gone(s: Surface, g: float, outwards: float, up: float) -> bool:
    """Whether a ray that is g in front of the end face, where it goes `outwards` and `up`, goes away from it for good.

    F is g less a bump or more; where g is convex along a ray it never falls again, and no bump reaches that far.
    """
    if s.twist != 0.0 or s.tilt_cos < 0.0 or g <= s.reserve - s.rough_reach:
        return False
    convex = s.bend == STRAIGHT or (s.bend == ARC and s.curvature > 0.0)
    return convex and outwards * s.tilt_cos - up * s.tilt_sin >= 0.0


@kernel
def _hollow(s: Surface) -> float:
    """Greatest curvature (1/mm) with which the end face bends towards the scanner: there F is not convex."""
    if s.bend == ARC:
        bend = max(-s.curvature, 0.0)
    elif s.bend == WAVY:
        bend = abs(s.wave_amplitude) * s.wave_number**2
    else:
        return 0.0
    return bend / max(1.0 - OUTREACH_MM * bend, 0.2)


@kernel
def _step(s: Surface, f: float, slope: float, norm: float, bend: float) -> float:
    """How far to go on along a ray where F is f and falls by `slope`, at most bending down by `bend`.

    By Newton, shortened where the face is hollow: a full step could pass the thin wedge at the lower edge. Never
    through a wall of a rough or burred part.
    """
    if s.relax > 0.0 and abs(f) > 1e-3:
        return max(s.relax * f, (f - s.reserve) / 1.05) / norm
    if bend > 0.0 and f > 0.0:
        return 2.0 * f / max(math.sqrt(slope * slope + 2.0 * bend * f) - slope, 1e-12)
    if slope < -1e-12:
        return -f / slope
    return s.relax * 1e-4 / norm if s.relax > 0.0 else math.inf


@kernel
def _step_to_cut(c: CutTerms, u: float, f: float, slope: float, norm: float) -> float:
    """As `_step` where F is the height f over the cut face. The raw part alone may be left out: the body is within."""
    if abs(f) <= 1e-3:
        return -f / slope if slope < -1e-12 else 1e-4 / norm
    relax = float(c.relax[min(max(int(u / c.u_step), 0), len(c.relax) - 1)])
    safe = relax * f / norm
    if relax > _EVEN and slope < -1e-12:
        safe = max(safe, -_DAMPED * f / slope)
    return min(safe, CUT_REACH_MM / norm)


@kernel
def enter(
    s: Surface, near: Float, o: Vector, d: Vector, lo: float, hi: float
) -> tuple[float, int, float, float, float]:
    """Where the ray o + a d, lo <= a <= hi, enters the part: a, face, u, distance v along m, cos(incidence).

    `near` is a plan point of the edge and the outward normal there, in whose neighbourhood the ray is followed.
    The face is NOTHING where it misses. A start inside the part counts as a hit at once.
    """
    lo, hi = _prism(s, near, o, d, lo, hi)
    a, norm = lo, math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    hollow = _hollow(s)
    cut = s.cut.height.shape[0] > 0
    for _ in range(400 if cut or s.relax > 0.0 else 60):
        if a > hi:
            break
        z = o[2] + a * d[2]
        u, h, tx, ty, unit = project(s, o[0] + a * d[0], o[1] + a * d[1])
        if _gone(s, h * s.tilt_cos - z * s.tilt_sin, d[0] * ty - d[1] * tx, d[2]):
            break
        f, face, fu, fh, fz = body(s, u, h, z)
        fu /= unit
        slope = fu * (d[0] * tx + d[1] * ty) + fh * (d[0] * ty - d[1] * tx) + fz * d[2]
        if abs(f) < _ON_FACE_MM or (a == lo and f < 0.0):
            steep = math.sqrt(fu * fu + fh * fh + fz * fz)
            tilt_cos, tilt_sin = lean(s, u)
            return a, face, u, z * tilt_cos + h * tilt_sin, -slope / (steep * norm)
        if cut and face == BEVEL:
            a += _step_to_cut(s.cut, u, f, slope, norm)
        else:
            sideways = abs(d[0] * tx + d[1] * ty) + 0.05 * norm
            a += _step(s, f, slope, norm, (hollow * sideways + 2.0 * abs(s.twist) * norm) * sideways)
    return math.inf, NOTHING, 0.0, 0.0, 0.0


@kernel
def drop(s: Surface, origins: Float, directions: Float, reach: float) -> Float:
    """How far it is from the origins (n, 3) along unit directions (n, 3) to the part, at most `reach`; else inf."""
    found, near = np.empty(origins.shape[0]), np.empty(4)
    for i in range(origins.shape[0]):
        o = (origins[i, 0], origins[i, 1], origins[i, 2])
        d = (directions[i, 0], directions[i, 1], directions[i, 2])
        x, y, tx, ty = edge_point(s, project(s, o[0], o[1])[0])
        near[0], near[1], near[2], near[3] = x, y, ty, -tx
        found[i] = enter(s, near, o, d, 0.0, reach)[0]
    return found


@kernel
def project_all(s: Surface, points: Float) -> Float:
    """u, h, and the tangent at u (n, 4) of points (n, 2) or (n, 3)."""
    found = np.empty((points.shape[0], 4))
    for i in range(points.shape[0]):
        found[i, 0], found[i, 1], found[i, 2], found[i, 3], _ = project(s, points[i, 0], points[i, 1])
    return found


@kernel
def edge_points(s: Surface, u: Float) -> Float:
    """Plan position x, y of the lower edge and its unit tangent (n, 4) at u (n,)."""
    found = np.empty((len(u), 4))
    for i in range(len(u)):
        found[i, 0], found[i, 1], found[i, 2], found[i, 3] = edge_point(s, u[i])
    return found


@kernel
def enter_box(boxes: Float, o: Vector, d: Vector, lo: float) -> tuple[float, float]:
    """Where the ray first enters one of the clamps, (inf, 0) if never, and cos(incidence) there.

    A box: plan centre x, y; tangent x, y; lower and upper limits along the tangent, outwards and upwards.
    """
    best, best_cos = math.inf, 0.0
    norm = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    for i in range(boxes.shape[0]):
        cx, cy, tx, ty = boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3]
        px, py = o[0] - cx, o[1] - cy
        first, last, cos = lo, math.inf, 1.0
        for axis in range(3):
            if axis == 0:
                p, q = px * tx + py * ty, d[0] * tx + d[1] * ty
            elif axis == 1:
                p, q = px * ty - py * tx, d[0] * ty - d[1] * tx
            else:
                p, q = o[2], d[2]
            low, high = boxes[i, 4 + 2 * axis] - p, boxes[i, 5 + 2 * axis] - p
            if abs(q) < 1e-15:
                if low > 0.0 or high < 0.0:
                    first = math.inf
                continue
            one, two = low / q, high / q
            if min(one, two) > first:
                first, cos = min(one, two), abs(q) / norm
            last = min(last, max(one, two))
        if first < last and first < best:
            best, best_cos = first, cos
    return best, best_cos


@kernel
def hidden(s: Surface, boxes: Float, near: Float, p: Vector, target: Vector) -> bool:
    """Whether part or clamps stand between the surface point p and `target`."""
    dx, dy, dz = target[0] - p[0], target[1] - p[1], target[2] - p[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    d = (dx / distance, dy / distance, dz / distance)
    if enter(s, near, p, d, _OFFSET_MM, distance)[1] != NOTHING:
        return True
    return boxes.shape[0] > 0 and enter_box(boxes, p, d, _OFFSET_MM)[0] < distance


def cast(
    s: Surface, boxes: Float, table_z: float, sensor: Sensor, part_from_profiler: Float, offsets: Float
) -> tuple[Float, AnyArray, Float, Float]:
    """Range of every ray (N, M; NaN: no return), its face, cos(incidence), and what each frame sees of the edge.

    Ranges count along the range axis from the emitter. `offsets` (M,) are the columns' lateral positions from the
    emitter (mm), or, where `sensor.angular`, the tangents of their angles. The last array (N, 4) holds, per frame,
    the number of returns from root face and bevel, the lowest return on the root face (distance from the lower edge)
    and its u.
    """
    n, m = part_from_profiler.shape[0], offsets.shape[0]
    ranges, cosines = np.full((n, m), np.nan), np.zeros((n, m))
    faces = np.zeros((n, m), np.uint8)
    sight = np.zeros((n, 4))
    made = ranges, faces, cosines, sight
    list(in_order(partial(_cast, s, (boxes, table_z), sensor, part_from_profiler, offsets, made), n, FRAMES_A_CALL))
    return made


@kernel
def _first_hit(
    s: Surface, around: tuple[Float, float], near: Float, origin: Vector, d: Vector, far: float
) -> tuple[float, int, float, float, float]:
    """What a ray meets first of part, clamps and table: how far, which face, u and v there, cos(incidence)."""
    boxes, table_z = around
    a, face, u, v, cos = enter(s, near, origin, d, 0.0, far)
    if boxes.shape[0] > 0:
        box, box_cos = enter_box(boxes, origin, d, 0.0)
        if box < a:
            a, face, cos = box, CLAMP, box_cos
    if d[2] < 0.0 and (table_z - origin[2]) / d[2] < a:
        a, face = (table_z - origin[2]) / d[2], TABLE
        cos = -d[2] / math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    return a, face, u, v, cos


@kernel
def _cast(
    s: Surface,
    around: tuple[Float, float],
    sensor: Sensor,
    part_from_profiler: Float,
    offsets: Float,
    made: tuple[Float, AnyArray, Float, Float],
    first: int,
    last: int,
) -> None:
    """Fill in frames first to last."""
    ranges, faces, cosines, sight = made
    near = np.empty(4)
    for i in range(first, last):
        pose = part_from_profiler[i]
        lateral, depth = (pose[0, 0], pose[1, 0], pose[2, 0]), (pose[0, 2], pose[1, 2], pose[2, 2])
        w = (depth[0] * sensor.sign, depth[1] * sensor.sign, depth[2] * sensor.sign)
        zero = (pose[0, 3], pose[1, 3], pose[2, 3])
        emitter = _along(_along(zero, lateral, sensor.emitter_x), depth, sensor.emitter_z)
        camera = _along(emitter, (pose[0, 1], pose[1, 1], pose[2, 1]), sensor.baseline)
        middle = _along(emitter, w, 0.5 * (sensor.near + sensor.far))
        x, y, tx, ty = edge_point(s, project(s, middle[0], middle[1])[0])
        near[0], near[1], near[2], near[3] = x, y, ty, -tx
        sight[i, 2], sight[i, 3] = math.inf, math.nan
        for j in range(offsets.shape[0]):
            origin, d = emitter, w
            if sensor.angular:
                d = _along(w, lateral, offsets[j])
            else:
                origin = _along(emitter, lateral, offsets[j])
            a, face, u, v, cos = _first_hit(s, around, near, origin, d, sensor.far)
            if face == NOTHING or a < sensor.near or a > sensor.far or cos < sensor.cos_min:
                continue
            p = _along(origin, d, a)
            if sensor.fan and not sensor.angular and hidden(s, around[0], near, p, emitter):
                continue
            if hidden(s, around[0], near, p, camera):
                continue
            ranges[i, j], faces[i, j], cosines[i, j] = a, face, cos
            if face == ROOT:
                sight[i, 0] += 1.0
                if v < sight[i, 2]:
                    sight[i, 2], sight[i, 3] = v, u
            elif face == BEVEL:
                sight[i, 1] += 1.0
