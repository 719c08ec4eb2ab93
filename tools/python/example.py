# SPDX-License-Identifier: MIT OR Apache-2.0
"""A notebook of the package in cells (`# %%`), which editors and Jupyter with jupytext open; a test runs it."""

# %% [markdown]
# # From particles to a surface
# A drop above a pool, 1 cm between the particles.

# %%
import numpy as np

import meniscus_fx as mf

spacing = 0.01
grid = np.mgrid[0:0.4:spacing, 0:0.4:spacing, 0:0.4:spacing].reshape(3, -1).T
centre = np.array([0.2, 0.2, 0.28])
in_drop = np.linalg.norm(grid - centre, axis=1) < 0.08
positions = grid[in_drop | (grid[:, 2] < 0.12)].astype(np.float32)
velocity = np.where(positions[:, 2:] > 0.15, np.float32([0, 0, -2]), np.float32(0))

# %% [markdown]
# The mesh is closed, and has the volume of the particles.

# %%
mesh = mf.reconstruct(positions, spacing, velocity=velocity)
expected = len(positions) * spacing**3
print(mesh, f"volume {mesh.volume:.5f} m³, of the particles {expected:.5f} m³")
assert mesh.is_sound and mesh.report["check"]["components"] == 2
assert abs(mesh.volume / expected - 1) < 0.05

# %% [markdown]
# Velocities arrive at the vertices, for motion blur: the drop falls, the pool is at rest.

# %%
falling = mesh.vertices[:, 2] > 0.18
print("velocity of the drop", mesh.attributes["velocity"][falling].mean(axis=0))
assert np.allclose(mesh.attributes["velocity"][falling], [0, 0, -2], atol=1e-3)
assert np.allclose(mesh.attributes["velocity"][mesh.vertices[:, 2] < 0.1], 0, atol=1e-3)
mesh.write("drop.ply")

# %% [markdown]
# # A simulation, its cache, and a surface of it

# %%
shot = mf.simulate("dam-break", "wave", quality="draft", frames="1-4", progress=print)
liquid = mf.cache.read(shot.frames[-1])["streams"]["liquid"]
channels = liquid["channels"]
print(liquid["len"], "particles,", sorted(channels))

surface = mf.reconstruct(channels["position"], liquid["scalars"]["spacing"], velocity=channels["velocity"])
speed = np.linalg.norm(surface.attributes["velocity"], axis=1)
print(surface, f"moves at up to {speed.max():.2f} m/s")
assert surface.is_sound and 0.1 < speed.max() < 10
