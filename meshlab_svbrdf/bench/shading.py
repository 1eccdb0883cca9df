"""What the workload's object looks like: paint, lamps, Phong's lobes (paper, eq. 1), as kernels.

All is a function of the place on the surface, so that a texel's true diffuse colour is known at any
texture size, and is the same expression that the frames are shaded by.
"""

from __future__ import annotations

import numpy as np

from ..jit import inner, kernel


@inner
def _wave(x):
    """Nearly a sine of period 1, of parabolas: a tenth of a sine's time."""
    t = x - np.floor(x + 0.5)
    return t * (8.0 - 16.0 * abs(t))


@inner
def _paint(x, y, z, colours, albedo):
    """Write the albedo at a place; its material."""
    height = y + 0.16 * _wave(0.64 * x) * _wave(0.64 * z + 0.25)
    material = 0 if height < -0.35 else (1 if height < 0.35 else 2)
    swirl = _wave(1.1 * y + 0.3 * x)
    mix = 0.5 + 0.32 * _wave(1.3 * x + 0.3 * swirl) * _wave(1.4 * z + 0.5 * y)
    mix += 0.18 * _wave(6.5 * x + 1.4 * y) * _wave(5.9 * y - 1.8 * z) * _wave(6.8 * z)
    for c in range(3):
        albedo[c] = colours[material, 0, c] * (1.0 - mix) + colours[material, 1, c] * mix
    return material


@inner
def _lamp(k, p, n, lamps, toward):
    """Write the unit direction to a lamp; intensity and cosine at a place."""
    square = 0.0
    for c in range(3):
        toward[c] = lamps[k, c] - p[c]
        square += toward[c] * toward[c]
    length = np.sqrt(square)
    cosine = 0.0
    for c in range(3):
        toward[c] /= length
        cosine += toward[c] * n[c]
    return lamps[k, 3] / square, cosine


@inner
def _interpolate(values, corners, weights, out):
    for c in range(out.shape[0]):
        out[c] = (
            weights[0] * values[corners[0], c]
            + weights[1] * values[corners[1], c]
            + weights[2] * values[corners[2], c]
        )


@inner
def _unit(v):
    length = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    v[0], v[1], v[2] = v[0] / length, v[1] / length, v[2] / length


@kernel
def _diffuse(p, n, seen, lamps, ambient, colours, albedo, toward, out):
    """Write D at a place (albedo times what it receives); its material."""
    material = _paint(p[0], p[1], p[2], colours, albedo)
    light = ambient
    for k in range(lamps.shape[0]):
        intensity, cosine = _lamp(k, p, n, lamps, toward)
        if cosine > 0.0:
            light += seen[k] * intensity * cosine
    for c in range(3):
        out[c] = albedo[c] * light
    return material


@kernel
def texel_diffuse(vertices, normals, seen, faces, face, weights, lamps, ambient, colours, D, kind):
    p, n, s = np.empty(3), np.empty(3), np.empty(lamps.shape[0])
    albedo, toward = np.empty(3), np.empty(3)
    for i in range(len(face)):
        corners = faces[face[i]]
        _interpolate(vertices, corners, weights[i], p)
        _interpolate(normals, corners, weights[i], n)
        _interpolate(seen, corners, weights[i], s)
        _unit(n)
        kind[i] = _diffuse(p, n, s, lamps, ambient, colours, albedo, toward, D[i])


@kernel
def shade(
    face_index, points, vertices, normals, seen, faces, intrinsics, eye,
    lamps, ambient, colours, rho_s, alpha, background, to_code, noise, shift, gloss, out,
):  # fmt: skip
    """Shade every pixel, add its noise and write its sRGB code; `background` is a code + .5."""
    height, width = face_index.shape
    fx, fy, cx, cy = intrinsics
    steps = len(to_code) - 1
    p, n, s = np.empty(3), np.empty(3), np.empty(lamps.shape[0])
    albedo, toward, view, mirror = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    weights, colour = np.empty(3), np.empty(3)
    for row in range(height):
        # Every row starts elsewhere in the noise
        start = (shift + 7919 * row) % (len(noise) - 3 * width)
        for col in range(width):
            f, at = face_index[row, col], start + 3 * col
            if f < 0:
                for c in range(3):
                    out[row, col, c] = np.uint8(min(max(background + noise[at + c], 0.0), 255.0))
                continue
            # Find the place behind the pixel
            corners = faces[f]
            dx, dy = (col - cx) / fx, (row - cy) / fy
            total = 0.0
            for i in range(3):
                a, b = points[corners[(i + 1) % 3]], points[corners[(i + 2) % 3]]
                weights[i] = (
                    dx * (a[1] * b[2] - a[2] * b[1])
                    + dy * (a[2] * b[0] - a[0] * b[2])
                    + (a[0] * b[1] - a[1] * b[0])
                )
                total += weights[i]
            for i in range(3):
                weights[i] /= total
            _interpolate(vertices, corners, weights, p)
            _interpolate(normals, corners, weights, n)
            _interpolate(seen, corners, weights, s)
            _unit(n)
            m = _diffuse(p, n, s, lamps, ambient, colours, albedo, toward, colour)
            if gloss and rho_s[m] > 0.0:
                # Add what it mirrors of the lamps and of the room
                for c in range(3):
                    view[c] = eye[c] - p[c]
                _unit(view)
                cosine = n[0] * view[0] + n[1] * view[1] + n[2] * view[2]
                for c in range(3):
                    mirror[c] = 2.0 * cosine * n[c] - view[c]
                lobe = ambient * 2.0 / (alpha[m] + 1.0)
                for k in range(lamps.shape[0]):
                    intensity, facing = _lamp(k, p, n, lamps, toward)
                    along = toward[0] * mirror[0] + toward[1] * mirror[1] + toward[2] * mirror[2]
                    if facing > 0.0 and along > 0.5:
                        lobe += s[k] * intensity * along ** alpha[m]
                for c in range(3):
                    colour[c] += rho_s[m] * lobe
            for c in range(3):
                code = to_code[int(min(max(colour[c], 0.0), 1.0) * steps + 0.5)] + noise[at + c]
                out[row, col, c] = np.uint8(min(max(code + 0.5, 0.0), 255.0))
