"""The shaders that draw every surface from its look (`looks.py`), its seed and the coordinates on it.

A pattern is a hash of the coordinates and the seed: two surfaces are alike only if their seeds are equal. Each part of
a pattern fades out before it gets finer than a pixel, so that nothing flickers as the camera moves. There is no branch
between kinds of surface, because a software renderer would evaluate all branches anyway.
"""

from __future__ import annotations

from waychair.simulation.sensors.looks import LOOK_ROWS, LOOKS

_VERSION = "#version 330\n"

LASER_THICK = 0.0008
"""m; half thickness of a laser's line at its lens, one sigma."""

LASER_SPREAD = 0.0003
"""rad; growth of that with the distance."""

LASER_BLUR = 0.5
"""Square of the lens's blur, one sigma, in pixels squared: a line is never thinner in the picture."""

VERTEX_SHADER = """
#version 330
uniform mat4 clip_from_map;
uniform vec4 looks[LOOKS * LOOK_ROWS];
in vec3 position;
in vec2 on_surface;
in vec2 on_light_map;
in float shade;
in uint seed;
in uint look;
out vec2 at;
out vec3 on_light;
flat out uint hashed;
flat out vec4 colour, clouds, joints, cells, contrasts, shape;
#ifdef LASER
uniform mat4 laser_from_map;
out vec3 in_laser;
#endif

void main() {
    gl_Position = clip_from_map * vec4(position, 1.0);
    int row = int(look) * LOOK_ROWS;
    colour = looks[row];
    clouds = looks[row + 1];
    joints = looks[row + 2];
    cells = looks[row + 3];
    contrasts = looks[row + 4];
    shape = looks[row + 5];
    vec3 own = vec3(float((seed >> 8) & 255u), float((seed >> 16) & 255u), float(seed >> 24)) / 255.0;
    colour.rgb *= mix(vec3(1.0), 0.1 + 1.8 * own, looks[row + 6].x);
    at = on_surface;
    on_light = vec3(on_light_map, shade);
    hashed = seed;
#ifdef LASER
    in_laser = (laser_from_map * vec4(position, 1.0)).xyz;
#endif
}
""".replace("LOOK_ROWS", str(LOOK_ROWS)).replace("LOOKS", str(len(LOOKS)))
"""Reads a surface's numbers from the table and varies its colour by its seed."""

FRAGMENT_SHADER = (
    """
#version 330
uniform float exposure;
uniform float opacity;
uniform sampler2D light_map;
in vec2 at;
in vec3 on_light;
flat in uint hashed;
flat in vec4 colour, clouds, joints, cells, contrasts, shape;
out vec4 picture;

#ifdef LASER
uniform sampler2D laser_depth;
uniform float laser_power;
uniform float laser_reach;
in vec3 in_laser;

// light of the line on this point: nothing beyond the first surface on its way, which laser_depth tells by the tangent
// of the angle in the fan. A pixel that is wider than the line takes its part of the light.
vec3 laser_light() {
    float z = max(in_laser.z, 1e-3);
    float tangent = in_laser.x / z;
    float first = texture(laser_depth, vec2(0.5 + 0.5 * tangent / laser_reach, 0.5)).r;
    vec3 normal = normalize(cross(dFdx(in_laser), dFdy(in_laser)));
    float away = length(in_laser);
    float facing = abs(dot(normal, in_laser)) / away;
    float thick = LASER_THICK + LASER_SPREAD * away;
    float span = fwidth(in_laser.y);
    float sigma = sqrt(thick * thick + LASER_BLUR * span * span);
    float across = exp(-0.5 * in_laser.y * in_laser.y / (sigma * sigma)) / sigma;
    bool lit = in_laser.z > 0.02 && abs(tangent) < laser_reach && z < first * 1.01 + 0.01;
    return lit ? vec3(1.0, 0.06, 0.03) * (laser_power * facing * across / away) : vec3(0.0);
}
#endif

uint hash(vec2 cell, uint seed) {
    uint h = uint(int(cell.x)) * 0x9E3779B1u ^ (uint(int(cell.y)) * 0x85EBCA77u + seed);
    h = (h ^ (h >> 15)) * 0x2C1B3C6Du;
    return (h ^ (h >> 13)) * 0x297A2D39u;
}

vec4 bytes(uint h) {
    return vec4(float(h & 255u), float((h >> 8) & 255u), float((h >> 16) & 255u), float(h >> 24)) * (1.0 / 255.0);
}

// -1 to 1, smooth; a cell of p is one blotch, w is how much of p one pixel spans
float cloud(vec2 p, vec2 w, uint seed) {
    vec2 cell = floor(p);
    vec2 f = p - cell;
    f = f * f * (3.0 - 2.0 * f);
    vec2 below = vec2(float(hash(cell, seed) >> 16), float(hash(cell + vec2(1.0, 0.0), seed) >> 16));
    vec2 above = vec2(float(hash(cell + vec2(0.0, 1.0), seed) >> 16), float(hash(cell + vec2(1.0, 1.0), seed) >> 16));
    vec2 column = mix(below, above, f.y) * (2.0 / 65535.0) - 1.0;
    return mix(column.x, column.y, f.x) * clamp(2.0 - 2.0 * max(w.x, w.y), 0.0, 1.0);
}

// a leaning rectangle in some of the cells of p: brighter or darker by up to 1, in three colours
vec3 mark(vec2 p, vec2 w, uint seed) {
    vec2 cell = floor(p);
    vec4 r = bytes(hash(cell, seed));
    vec2 q = p - cell - 0.5 - (r.xy - 0.5) * 0.4;
    float lean = (r.z - 0.5) * shape.z;
    q += vec2(-lean, lean) * q.yx;
    vec2 span = w + abs(lean) * w.yx;
    vec2 reach = 0.12 + 0.24 * r.yz;
    vec2 cover = clamp((reach - abs(q)) / span + 0.5, 0.0, 1.0);
    vec3 tones = mix(vec3(r.w / shape.x), r.zxy, clouds.w) * 2.0 - 1.0;
    return r.w < shape.x ? tones * (cover.x * cover.y * clamp(1.8 - 2.0 * max(w.x, w.y), 0.0, 1.0)) : vec3(0.0);
}

void main() {
    vec2 point = at;
    vec2 w = abs(dFdx(at)) + abs(dFdy(at)) + 1e-6;
    vec3 tone = vec3(1.0 + clouds.z * cloud(point * clouds.xy, w * clouds.xy, hashed));

    vec2 tile = point * joints.xy;
    vec2 inner = 0.5 - abs(fract(tile) - 0.5);
    vec2 thick = 0.5 * joints.z * joints.xy;
    vec2 soft = w * joints.xy + 1e-6;
    vec2 line = clamp((thick - inner) / soft + 0.5, 0.0, 1.0) * min(2.0 * thick / soft, 1.0);
    tone *= 1.0 - joints.w * max(line.x, line.y);
    tone *= 1.0 + shape.w * (float(hash(floor(tile), hashed + 77u) >> 24) / 127.5 - 1.0) * clamp(2.0 - 2.0 * max(soft.x, soft.y), 0.0, 1.0);

    point.x *= shape.y;
    w.x *= shape.y;
    tone += contrasts.x * mark(point * cells.x, w * cells.x, hashed + 11u);
    tone += contrasts.y * mark(point * cells.y, w * cells.y, hashed + 22u);
    tone += contrasts.z * mark(point * cells.z, w * cells.z, hashed + 33u);
    tone += contrasts.w * mark(point * cells.w, w * cells.w, hashed + 44u);

    vec3 lit = texture(light_map, on_light.xy).rgb * on_light.z;
#ifdef LASER
    lit += laser_light() * clamp(2.5 * colour.a - 1.25, 0.0, 1.0); // smooth black things and mirrors send it elsewhere
#endif
    // the square root leaves shot noise alike at all brightnesses, and eight bits enough for dim corners
    picture = vec4(sqrt(clamp(colour.rgb * tone * lit * exposure, 0.0, 1.0)), opacity < 1.0 ? opacity : colour.a);
}
""".replace("LASER_THICK", f"{LASER_THICK:.6f}")
    .replace("LASER_SPREAD", f"{LASER_SPREAD:.6f}")
    .replace("LASER_BLUR", f"{LASER_BLUR:.6f}")
)
"""Draws any surface; the alpha is the part of light that returns to a depth camera."""


def with_laser(shader: str) -> str:
    """Return a shader that also draws a laser's line; without this, nothing of the laser is compiled."""
    return shader.replace(_VERSION, _VERSION + "#define LASER\n", 1)
