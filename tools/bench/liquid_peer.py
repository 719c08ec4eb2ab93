"""Runs one scene in pysplishsplash, in a process of its own: `python liquid_peer.py JOB.json`.

Started by liquids.py with the Python of its virtual environment. The job names the scene, the method and a folder;
the folder gets `frame_0000.npz` (position, velocity, density as the solver reports it) for the initial state and
every frame after it, and `result.json`.

What is timed: wall and CPU seconds of all threads between the end of one step and the end of the next, less what
this file spends on writing frames. The first step is left out, with its 1 ms of simulated time: building the
boundary's volume map hides in it. The peak of the memory is taken from there on too.

Facts about the peer that decide what is compared:
- A particle of radius r has (2r)³ of rest volume, the support is 4r and the kernel a cubic spline. (Up to version 2.16
  it had 0.8 (2r)³: their figures are of another liquid.)
- The wheel is built with AVX2 and FMA, which its solvers use throughout, and computes in single precision.
- PBF holds its tolerance while it iterates, not in the positions that it leaves: their mean compression is far above
  0.1 %, their largest above 10 %, at either tolerance. On two threads its positions differ from run to run.
- `maxError` is in per cent of the rest density, and bounds the mean of max(ρ/ρ₀ − 1, 0) over all particles; for
  DFSPH that of the density predicted from the velocities, not that of the positions. `maxErrorV` is per cent a step.
- At `maxIterations` a step ends above its target without a message; such steps are counted here.
- Walls are meshes whose surface represents a layer of particle centres, so the mesh must lie outside of the tank.
  A block that starts too near is thrown apart before the first frame (at r/2 + 2r with 37 m/s): `wall` is the number of
  radii by which the mesh is moved out. 1.5 with boundary particles and 2.5 with volume maps are the smallest that start
  calm; the liquid then reaches about half a spacing beyond the tank on every side.
- Step size: min(cflMaxTimeStepSize, cflFactor · 0.4 · 2r / fastest speed). With its default of 5 ms, DFSPH throws a
  column of 49 layers apart after 0.1 s (27 m/s) without ever reaching its iteration limit; with 2 ms the column rests,
  after as many iterations in sum. Its scenes have 5 ms at 2r = 5 cm: the job's limit keeps that ratio.
- Frames are the states after the first step past their time: the step is not shortened to hit it.
"""

import json
import os
import pathlib
import sys
import time

# The peer's numbers: WCSPH 0, PCISPH 1, PBF 2, IISPH 3, DFSPH 4.
METHODS = {"PBF": 2, "DFSPH": 4}
BOUNDARIES = {"particles": 0, "volume-map": 2}
MAX_ITERATIONS = 100
# Term of a job: suffix of the fluid's accessors, the peer's number of the method and its name, and the coefficients to set.
TERMS = {
    "surface tension": ("SurfaceTension", 2, "Akinci et al. 2013", {}),
    "viscosity": (
        "Viscosity",
        6,
        "Weiler et al. 2018",
        {"VISCOSITY_COEFFICIENT": 0.01, "VISCOSITY_COEFFICIENT_BOUNDARY": 0.01},
    ),
}

# A cube from −0.5 to 0.5.
CUBE = """v -0.5 -0.5 -0.5
v 0.5 -0.5 -0.5
v 0.5 0.5 -0.5
v -0.5 0.5 -0.5
v -0.5 -0.5 0.5
v 0.5 -0.5 0.5
v 0.5 0.5 0.5
v -0.5 0.5 0.5
f 1 3 2
f 1 4 3
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 2 3 7
f 2 7 6
f 3 4 8
f 3 8 7
f 4 1 5
f 4 5 8
"""


def scene(job):
    """The peer's scene file: the block as a FluidBlock, the tank as an inverted box."""
    radius = job["radius"]
    wall = job["wall"] * radius
    size = [side + 2 * wall for side in job["tank"]]
    # A cell of the map is four particles wide, as in the project's own scenes; the map reaches 16 further than the box.
    cells = [round((side + 2 * 16 * 2 * radius) / (4 * 2 * radius)) for side in size]
    return {
        "Configuration": {
            "particleRadius": radius,
            "simulationMethod": METHODS[job["method"]],
            "gravitation": [0, 0, -9.81],
            "cflMethod": 1,
            "cflFactor": 1,
            "cflMaxTimeStepSize": job["longest_step"],
            "boundaryHandlingMethod": BOUNDARIES[job["boundary"]],
            "enableZSort": True,
            job["method"]: {"maxError": job["tolerance"], "maxIterations": MAX_ITERATIONS},
        },
        "Materials": [{"id": "Fluid", "density0": 1000, "viscosityMethod": 0, "XSPH": {"xsph": job["xsph"]}}],
        "RigidBodies": [
            {
                "geometryFile": "cube.obj",
                "translation": [side / 2 for side in job["tank"]],
                "scale": size,
                "isDynamic": False,
                "isWall": True,
                "mapInvert": True,
                "mapThickness": 0.0,
                "mapResolution": cells,
            }
        ],
        # The block's seeding lattice starts and ends one diameter inside of these corners.
        "FluidBlocks": [{"denseMode": 0, "start": [-radius] * 3, "end": [(2 * n + 1) * radius for n in job["counts"]]}],
    }


def enable(fluid, suffix, number, name, coefficients):
    """Enables a non-pressure force of the fluid, and checks that it is the intended one with its coefficients."""
    getattr(fluid, f"set{suffix}Method")(number)
    method = getattr(fluid, f"get{suffix}Base")()
    if method.getMethodName() != name:
        sys.exit(f"the peer's method {number} is {method.getMethodName()!r}, expected {name!r}")
    for key, value in coefficients.items():
        method.setValueFloat(getattr(method, key), value)
        found = method.getValueFloat(getattr(method, key))
        if abs(found - value) > 1e-6 * value:
            sys.exit(f"the peer took {key} {found!r}, expected {value!r}")


def status(key):
    """A memory figure of this process, from /proc [bytes]; None where the system has none."""
    try:
        lines = pathlib.Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(key + ":")), None)


def main():
    job = json.loads(pathlib.Path(sys.argv[1]).read_text())
    folder = pathlib.Path(job["folder"])
    scenes = pathlib.Path(job["scenes"])
    scenes.mkdir(parents=True, exist_ok=True)
    (scenes / "cube.obj").write_text(CUBE)
    path = scenes / f"{folder.name}.json"
    path.write_text(json.dumps(scene(job), indent=1))

    import numpy
    import pysplishsplash

    base = pysplishsplash.Exec.SimulatorBase()
    # Volume maps are kept next to the scene file, for the next run.
    base.init(useGui=False, sceneFile=str(path), outputDir=str(folder / "out"), initialPause=False, useCache=True)
    bare = status("VmRSS")
    base.initSimulation()
    simulation = pysplishsplash.Simulation.getCurrent()
    fluid = simulation.getFluidModel(0)
    steps = simulation.getTimeStep()
    if job["term"]:
        enable(fluid, *TERMS[job["term"]])
    # The peer ignores unknown keys without a message, so the values that it took are compared.
    taken = {
        "method": steps.getMethodName(),
        "tolerance": steps.getValueFloat(steps.MAX_ERROR),
        "iterations": steps.getValueUInt(steps.MAX_ITERATIONS),
        "xsph": fluid.getXSPH().getValueFloat(fluid.getXSPH().FLUID_COEFFICIENT),
    }
    for key, value in taken.items():
        wanted = MAX_ITERATIONS if key == "iterations" else job[key]
        if value != (wanted if isinstance(wanted, str) else numpy.float32(wanted)):
            sys.exit(f"the peer took {key} {value!r}, expected {wanted!r}")
    clock = pysplishsplash.TimeManager.getCurrent()
    timing, counting = pysplishsplash.Utilities.Timing, pysplishsplash.Utilities.Counting
    particles = fluid.numActiveParticles()
    expected = job["counts"][0] * job["counts"][1] * job["counts"][2]
    if particles != expected:
        sys.exit(f"the peer seeded {particles} particles, expected {expected}")

    def field(name):
        return numpy.array(fluid.getFieldBuffer(name), copy=False)[:particles]

    for name in ("position", "position0"):
        # The same seeding lattice as the other program's, whatever the radius.
        axes = [(numpy.arange(n) + 0.5) * job["spacing"] for n in job["counts"]]
        field(name)[:] = numpy.stack(numpy.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    def write(frame, at):
        numpy.savez(
            folder / f"frame_{frame:04}.npz",
            position=field("position"),
            velocity=field("velocity"),
            density=field("density") / fluid.getDensity0(),
            time=at,
        )

    state = {"frame": 0, "steps": 0, "wall": 0.0, "cpu": 0.0, "iterations": 0, "divergence": 0, "capped": 0}
    write(0, 0.0)

    def after_step():
        if state["steps"] > 0:
            state["wall"] += time.perf_counter() - state["mark_wall"]
            state["cpu"] += time.process_time() - state["mark_cpu"]
            pressure = steps.getNumIterations()
            state["iterations"] += pressure
            state["capped"] += pressure >= MAX_ITERATIONS
            if job["method"] == "DFSPH":
                state["divergence"] += steps.getValueUInt(steps.SOLVER_ITERATIONS_V)
        else:
            timing.reset()
            counting.reset()
            state["from"] = clock.getTime()
            try:
                pathlib.Path("/proc/self/clear_refs").write_text("5")
                state["peak_reset"] = True
            except OSError:
                state["peak_reset"] = False
        state["steps"] += 1
        while clock.getTime() >= (state["frame"] + 1) / job["fps"]:
            state["frame"] += 1
            write(state["frame"], clock.getTime())
        state["mark_wall"] = time.perf_counter()
        state["mark_cpu"] = time.process_time()

    base.setTimeStepCB(after_step)
    base.setValueFloat(base.STOP_AT, job["frames"] / job["fps"])
    base.runSimulation()

    passes = {entry.name: entry.totalTime / 1000 for entry in timing.m_averageTimes.values()}
    iterations = state["iterations"] + state["divergence"]
    solve = passes.get("pressureSolve", 0.0) + passes.get("divergenceSolve", 0.0)
    result = {
        "particles": particles,
        "particle_volume": fluid.getVolume(0),
        "support": simulation.getSupportRadius(),
        "simulated": clock.getTime() - state["from"],
        "wall": state["wall"],
        "cpu": state["cpu"],
        "steps": state["steps"] - 1,
        "iterations": iterations,
        "unconverged": state["capped"],
        "iteration_ns": 1e9 * solve / (iterations * particles),
        "search_share": passes["neighborhood_search"] / passes["SimStep"],
        "memory": status("VmHWM"),
        "memory_bare": bare,
        "peak_without_start": state["peak_reset"],
        "passes": passes,
    }
    (folder / "result.json").write_text(json.dumps(result))
    # The module's static objects take the process down on the way out; the result is written.
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
