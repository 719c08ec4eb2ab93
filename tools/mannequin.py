#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Makes the mannequin of the preset wading: presets/assets/walker.ply, and its walk along x as a point cache, walker.pc2.

    tools/mannequin.py                      both files
    tools/mannequin.py -o /some/where       elsewhere

Closed parts of revolution lie along bones, which swing about hips, knees, shoulders and elbows. The lowest vertex is at the floor in each
sample. Needs NumPy.
"""

import argparse
import pathlib
import struct

import numpy as np

# Vertices around a part and rings along it; a pole at each end comes on top.
SEGMENTS, RINGS = 12, 5
FPS, FRAMES, FRAMES_PER_SAMPLE = 24.0, 72, 3
# Seconds of a cycle of two steps, the part of it that a foot is on the floor, and the largest angle of a hip.
CYCLE, ON_FLOOR, HIP = 1.4, 0.6, np.radians(26.0)
THIGH, SHIN = 0.44, 0.42
START, FLOOR_GAP = 0.5, 0.006
# A foot on the floor stays there: the hips move by two steps of the legs in the time that each is on the floor.
SPEED = 2.0 * (THIGH + SHIN) * np.sin(HIP) / (ON_FLOOR * CYCLE)
UP = np.array([0.0, 0.0, 1.0])


def part(start, end, radii, flat=1.0):
    """Vertices of a round cone between two points, with round ends; `flat` scales it across."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length, (first, last) = np.linalg.norm(end - start), radii
    axis = (end - start) / length
    side = np.cross([0.0, 1.0, 0.0], axis)
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(axis, side), axis])
    rings = [(-0.72 * first, 0.7 * first), (0.0, first), (0.5 * length, 0.515 * (first + last)), (length, last)]
    rings.append((length + 0.72 * last, 0.7 * last))
    angles = 2.0 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    around = np.stack([np.cos(angles), flat * np.sin(angles)], axis=1)
    bands = [np.column_stack([radius * around, np.full(SEGMENTS, height)]) for height, radius in rings]
    poles = [[0.0, 0.0, -first]], [[0.0, 0.0, length + last]]
    return np.concatenate([poles[0], *bands, poles[1]]) @ axes + start


def faces(parts):
    """Triangles of all parts, counter-clockwise seen from outside."""
    around = [(k, (k + 1) % SEGMENTS) for k in range(SEGMENTS)]
    last = 1 + (RINGS - 1) * SEGMENTS
    found = [[0, 1 + b, 1 + a] for a, b in around]
    for low in range(1, last, SEGMENTS):
        high = low + SEGMENTS
        found += [face for a, b in around for face in ([low + a, low + b, high + b], [low + a, high + b, high + a])]
    found += [[last + SEGMENTS, last + a, last + b] for a, b in around]
    return np.concatenate([np.array(found) + i * (SEGMENTS * RINGS + 2) for i in range(parts)])


def leg(phase):
    """Angles of hip and knee at a part of the cycle: straight on the floor, bent as the foot swings forward."""
    phase %= 1.0
    if phase < ON_FLOOR:
        part_of = phase / ON_FLOOR
        return HIP * (1.0 - 2.0 * part_of), np.radians(8.0 + 10.0 * np.sin(np.pi * part_of) ** 2)
    part_of = (phase - ON_FLOOR) / (1.0 - ON_FLOOR)
    smooth = part_of * part_of * (3.0 - 2.0 * part_of)
    hip = HIP * (2.0 * smooth - 1.0) + np.radians(14.0) * np.sin(np.pi * part_of)
    return hip, np.radians(8.0 + 58.0 * np.sin(np.pi * min(1.0, 1.05 * part_of)) ** 2)


def below(angle):
    """The direction that hangs down, turned forward by an angle."""
    return np.array([np.sin(angle), 0.0, -np.cos(angle)])


def pose(time):
    """Vertices of all parts at a time."""
    phase = time / CYCLE
    legs = leg(phase), leg(phase + 0.5)
    hips = np.array([START + SPEED * time, 0.02 * np.sin(2.0 * np.pi * phase), 0.0])
    spine = np.array([np.sin(np.radians(7.0)), 0.0, np.cos(np.radians(7.0))])
    chest, neck = hips + 0.36 * spine, hips + 0.53 * spine
    head = neck + 0.17 * np.array([np.sin(np.radians(2.0)), 0.0, np.cos(np.radians(2.0))])
    parts = [
        part(hips - 0.02 * spine, hips + 0.10 * spine, (0.135, 0.12), 0.85),
        part(hips + 0.17 * spine, chest, (0.115, 0.16), 0.8),
        part(chest + 0.05 * spine, neck + 0.03 * spine, (0.075, 0.055)),
        part(head - 0.04 * spine, head + 0.05 * spine, (0.085, 0.095), 0.92),
    ]
    for side, (hip, knee), arm_phase in ((1, legs[0], phase + 0.5), (-1, legs[1], phase)):
        top = hips + np.array([0.0, 0.095 * side, -0.03])
        bend = top + THIGH * below(hip)
        ankle = bend + SHIN * below(hip - knee)
        foot = below(hip - knee + np.pi / 2.0 - 0.9 * max(0.0, knee - hip - 0.2))
        parts += [part(top, bend, (0.088, 0.06)), part(bend, ankle, (0.058, 0.042))]
        parts.append(part(ankle - 0.05 * foot - 0.02 * UP, ankle + 0.15 * foot - 0.025 * UP, (0.042, 0.036)))
        swing = np.radians(22.0) * np.sin(2.0 * np.pi * arm_phase)
        shoulder = chest + np.array([0.0, 0.195 * side, 0.06])
        elbow = shoulder + 0.276 * (below(swing + np.radians(6.0)) + np.array([0.0, 0.32 * side, 0.0]))
        wrist = elbow + 0.25 * (below(swing + np.radians(48.0)) + np.array([0.0, 0.12 * side, 0.0]))
        hand = wrist + 0.07 * (wrist - elbow) / np.linalg.norm(wrist - elbow)
        parts += [part(shoulder, elbow, (0.056, 0.044)), part(elbow, wrist, (0.043, 0.034))]
        parts.append(part(wrist, hand, (0.036, 0.03), 1.2))
    vertices = np.concatenate(parts)
    vertices[:, 2] += FLOOR_GAP - vertices[:, 2].min()
    return vertices.astype("<f4"), len(parts)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = pathlib.Path(__file__).resolve().parent.parent / "presets" / "assets"
    parser.add_argument("-o", "--output", type=pathlib.Path, default=default, help="the folder (default: presets/assets)")
    folder = parser.parse_args().output
    samples = [pose(frame / FPS) for frame in range(0, FRAMES + 1, FRAMES_PER_SAMPLE)]
    vertices, parts = samples[0]
    triangles = faces(parts)
    header = [
        "ply\nformat binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(triangles)}",
        "property list uchar ushort vertex_indices\nend_header\n",
    ]
    rows = b"".join(struct.pack("<BHHH", 3, *triangle) for triangle in triangles)
    (folder / "walker.ply").write_bytes("\n".join(header).encode() + vertices.tobytes() + rows)
    head = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, len(vertices), 1.0, FRAMES_PER_SAMPLE, len(samples))
    (folder / "walker.pc2").write_bytes(head + b"".join(vertices.tobytes() for vertices, _ in samples))


if __name__ == "__main__":
    main()
