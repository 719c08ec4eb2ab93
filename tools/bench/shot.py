#!/usr/bin/env python3
"""Measures a shot from preset to meshes and prints a table in Markdown.

    tools/bench/shot.py dam-break --frames 1-48

Runs the release binary once for every number of threads, in turn, each time from an empty folder. Needs only Python's
standard library, and a machine that does nothing else.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]


def run(arguments):
    """Runs the tool; returns (wall seconds, CPU seconds, peak memory in bytes) of that process alone."""
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        # A process of its own, so that the peak memory is this run's and not that of the largest before it.
        import resource
        import time

        os.close(read_end)
        start = time.perf_counter()
        done = subprocess.run([str(a) for a in arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        wall = time.perf_counter() - start
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        figures = [wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024]
        errors = done.stderr.decode(errors="replace")[-2000:]
        with os.fdopen(write_end, "w") as out:
            json.dump({"code": done.returncode, "errors": errors, "figures": figures}, out)
        os._exit(0)
    os.close(write_end)
    with os.fdopen(read_end) as answer:
        result = json.load(answer)
    os.waitpid(child, 0)
    if result["code"] != 0:
        sys.exit(f"{' '.join(map(str, arguments))} ended with {result['code']}:\n{result['errors']}")
    return result["figures"]


def measure(binary, preset, frames, threads, extra, folder):
    """The figures of one run on `threads` threads, by name."""
    shot = folder / f"{preset}-{threads}"
    common = ["--threads", threads, "--progress", "none"]
    wall, cpu, memory = run([binary, "simulate", preset, "--frames", frames, "-o", shot, *extra, *common])
    records = [json.loads(line) for line in (shot / "log.jsonl").read_text().splitlines()]
    # Builds before November 2026 log the liquid's figures at the top of a record.
    records = [{**record, **record.get("liquid", {})} for record in records]
    mesh_wall, _, mesh_memory = run([binary, "mesh", shot, *common])
    meshes = list((shot / "mesh").iterdir())

    seconds = {}
    for record in records:
        for name, value in record["seconds"]:
            seconds[name] = seconds.get(name, 0.0) + value
    computed = len(records)
    particles = records[-1]["particles"]
    sweeps = sum(r["iterations"] * r["particles"] for r in records)
    # One build a substep: those between iterations are booked on the solver.
    searches = sum(r["substeps"] * r["particles"] for r in records)
    total = sum(seconds.values())
    return {
        "particles": f"{particles:,}".replace(",", " "),
        "seconds a frame (wall)": f"{wall / computed:.2f}",
        "seconds a frame (CPU)": f"{cpu / computed:.2f}",
        "substeps / iterations a frame": f"{mean(records, 'substeps'):.1f} / {mean(records, 'iterations'):.1f}",
        "ns per particle per iteration": f"{1e9 * seconds['solve'] / sweeps:.0f}",
        "ns per particle per neighbour search": f"{1e9 * seconds['search'] / searches:.0f}",
        "compression of the bulk, mean": f"{100 * mean(records, 'compression_avg'):.3f} %",
        "dilation of the bulk, mean": f"{100 * mean(records, 'dilation_avg'):.3f} %",
        "volume, largest change": f"{100 * max((r['volume_change'] for r in records), key=abs):+.2f} %",
        "density deviation, mean of averages": f"{100 * mean(records, 'density_dev_avg'):.3f} %",
        "density deviation, mean of maxima": f"{100 * mean(records, 'density_dev_max'):.2f} %",
        "density deviation, largest": f"{100 * max(r['density_dev_max'] for r in records):.2f} %",
        "peak memory, simulation": f"{memory / 2**20:.0f} MiB ({memory / particles:.0f} B a particle)",
        "cache bytes a particle and frame": f"{mean(records, 'bytes') / particles:.1f}",
        "meshing, seconds a frame": f"{mesh_wall / len(meshes):.2f}",
        "peak memory, meshing": f"{mesh_memory / 2**20:.0f} MiB",
        "mesh bytes a frame": f"{sum(m.stat().st_size for m in meshes) / len(meshes) / 2**20:.1f} MiB",
        "share of each pass": ", ".join(f"{k} {100 * v / total:.0f} %" for k, v in seconds.items()),
    }


def mean(records, key):
    return statistics.fmean(record[key] for record in records)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("preset")
    parser.add_argument("--frames", default="1-48")
    parser.add_argument("--threads", default="1,2", help="numbers of threads, with commas (default 1,2)")
    parser.add_argument("--set", action="append", default=[], help="passed to the tool")
    parser.add_argument("--quality", help="passed to the tool")
    parser.add_argument("--binary", default=ROOT / "target/release/meniscus")
    options = parser.parse_args()
    extra = [word for key in options.set for word in ("--set", key)]
    extra += ["--quality", options.quality] if options.quality else []
    counts = [int(n) for n in options.threads.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        columns = [
            measure(options.binary, options.preset, options.frames, n, extra, pathlib.Path(folder)) for n in counts
        ]
    print(f"| {options.preset}, frames {options.frames} |" + "".join(f" {n} thread{'s' * (n > 1)} |" for n in counts))
    print("|---|" + "---|" * len(counts))
    for name in columns[0]:
        print(f"| {name} |" + "".join(f" {column[name]} |" for column in columns))


if __name__ == "__main__":
    main()
