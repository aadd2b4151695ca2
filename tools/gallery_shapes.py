#!/usr/bin/env python3
"""Writes the meshes that the gallery needs beside those of Debian: a thin-walled vessel and a terrain, as binary PLY.

usage: gallery_shapes.py FOLDER      writes vessel.ply and terrain.ply
"""
import math
import os
import random
import struct
import sys

AROUND = 256    # columns of the vessel
CELLS = 317     # of the terrain on a side: 2 * 317^2 = 200,978 triangles
OCTAVES = 7
BASE, BEVEL = 0.013, 0.012    # height and slope's width of the slab that the terrain is cut from


def write_ply(path, vertices, triangles):
    """Vertices are x, y, z, s, t. The first byte must not look like white space, which Assimp skips."""
    assert struct.pack('<f', vertices[0][0])[0] not in b' \t\n\r\f\v'
    with open(path, 'wb') as file:
        file.write((f'ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n'
                    'property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n'
                    f'element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n').encode())
        for vertex in vertices:
            file.write(struct.pack('<5f', *vertex))
        for triangle in triangles:
            file.write(struct.pack('<B3i', 3, *triangle))


def grid(columns, rows):
    """Triangles of (columns + 1) x (rows + 1) vertices, counter-clockwise where columns run right and rows up."""
    triangles = []
    for j in range(rows):
        for i in range(columns):
            a = j * (columns + 1) + i
            b, c, d = a + 1, a + columns + 1, a + columns + 2
            triangles += [(a, b, d), (a, d, c)]
    return triangles


def smooth(points, steps):
    """A Catmull-Rom curve through the points."""
    curve = []
    for k in range(len(points) - 1):
        p = [points[max(k - 1, 0)], points[k], points[k + 1], points[min(k + 2, len(points) - 1)]]
        for i in range(steps):
            t = i / steps
            curve.append(tuple(0.5 * (2 * p[1][a] + (p[2][a] - p[0][a]) * t +
                                      (2 * p[0][a] - 5 * p[1][a] + 4 * p[2][a] - p[3][a]) * t * t +
                                      (3 * p[1][a] - p[0][a] - 3 * p[2][a] + p[3][a]) * t ** 3) for a in range(2)))
    return curve + [points[-1]]


def vessel(path):
    """A bowl like a lens on a foot: the outer wall upwards, over the lip, the inner wall down again."""
    outline = [(0.015, 0), (22, 0), (24, 3), (17, 9), (30, 18), (52, 32), (63, 50), (60, 66), (50, 76),
               (48.5, 77.5), (47, 76.5),
               (55.5, 65), (58.5, 50), (48, 35), (28, 23), (10, 18), (0.015, 17)]
    curve = smooth(outline, 12)
    along, vertices = 0.0, []
    for k, (radius, height) in enumerate(curve):
        if k:
            along += math.dist(curve[k - 1], curve[k])
        for i in range(AROUND + 1):
            angle = 2 * math.pi * i / AROUND
            vertices.append((radius * math.cos(angle), radius * math.sin(angle), height, 45 * angle, along))
    scale = 2 * math.pi * 45    # texture coordinates of 0 to 1
    vertices = [(x, y, z, s / scale, t / scale) for x, y, z, s, t in vertices]
    write_ply(path, vertices, grid(AROUND, len(curve) - 1))


def noise_lattice(generator, size):
    return [[generator.random() for _ in range(size + 3)] for _ in range(size + 3)]


def sample(lattice, x, y):
    i, j = int(x), int(y)
    u, v = (f * f * f * (f * (6 * f - 15) + 10) for f in (x - i, y - j))
    low = lattice[j][i] * (1 - u) + lattice[j][i + 1] * u
    high = lattice[j + 1][i] * (1 - u) + lattice[j + 1][i + 1] * u
    return low * (1 - v) + high * v


def terrain(path):
    """Ridges and valleys of fractal noise on a bevelled slab of side 1."""
    generator = random.Random(7)
    layers = [(3 * 2 ** k, noise_lattice(generator, 3 * 2 ** k)) for k in range(OCTAVES)]
    vertices = []
    for j in range(CELLS + 1):
        for i in range(CELLS + 1):
            x, y = i / CELLS, j / CELLS
            height, weight, gain = 0.0, 1.0, 1.0
            for size, lattice in layers:
                ridge = (1 - abs(2 * sample(lattice, x * size, y * size) - 1)) ** 2
                height += weight * gain * ridge
                gain = min(1.0, 1.4 * ridge)   # rough peaks, smooth valleys
                weight *= 0.42
            rim = min(x, 1 - x, y, 1 - y) / 0.12
            sink = 1 if rim >= 1 else rim * rim * (3 - 2 * rim)
            bevel = min(1, min(x, 1 - x, y, 1 - y) / BEVEL)
            vertices.append((x - 0.5, y - 0.5, BASE * bevel + 0.085 * height * sink, x, y))
    write_ply(path, vertices, grid(CELLS, CELLS))


def main():
    vessel(os.path.join(sys.argv[1], 'vessel.ply'))
    terrain(os.path.join(sys.argv[1], 'terrain.ply'))


if __name__ == '__main__':
    main()
