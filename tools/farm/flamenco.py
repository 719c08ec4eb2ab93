#!/usr/bin/env python3
"""Compiles the job of a shot with Flamenco's job type under node, runs its tasks on two workers, kills one, and compares.

    tools/farm/flamenco.py [--binary MENISCUS]

Flamenco itself is not run: a stub takes the place of its `author`, and two threads of this program that of its workers, which
run a task when those before it are done, and again if it fails. Exits with 1 at the first difference.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import threading

import common


def compiled(desk, shot):
    """The tasks of the submission in a folder."""
    script = pathlib.Path(__file__).with_suffix(".js")
    return json.loads(common.run(["node", script, shot / "meniscus.js", shot / "farm.flamenco.json"], desk))


class Farm:
    """Two workers."""

    def __init__(self, tasks, desk):
        self.tasks, self.desk, self.lock = tasks, desk, threading.Condition()
        self.state, self.failures = ["queued"] * len(tasks), []

    def work(self):
        while True:
            with self.lock:
                while True:
                    if all(state == "done" for state in self.state):
                        return
                    ready = [place for place, task in enumerate(self.tasks) if self.state[place] == "queued"
                             and all(self.state[other] == "done" for other in task["after"])]
                    if ready:
                        break
                    self.lock.wait()
                place = ready[0]
                self.state[place] = "active"
            (command,) = self.tasks[place]["commands"]
            words = [command["parameters"]["exe"], *command["parameters"]["args"]]
            done = subprocess.run(words, cwd=self.desk, capture_output=True, text=True, check=False)
            with self.lock:
                # Flamenco's manager gives a failed task to a worker again, three times unless configured otherwise.
                self.state[place] = "done" if done.returncode == 0 else "queued"
                if done.returncode:
                    self.failures.append((self.tasks[place]["name"], done.returncode, done.stderr))
                if len(self.failures) > 3:
                    sys.exit(f"too many failures: {self.failures}")
                self.lock.notify_all()

    def run(self):
        workers = [threading.Thread(target=self.work) for _ in range(2)]
        for worker in workers:
            worker.start()
        return workers


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", type=pathlib.Path, default=common.ROOT / "target/release/meniscus")
    binary = parser.parse_args().binary.resolve()
    with tempfile.TemporaryDirectory() as place:
        desk = pathlib.Path(place).resolve()
        local = common.local_run(binary, desk)
        shot = desk / common.AWKWARD.replace("{{", "").replace("}}", "")
        farm = ["--threads", 1, "farm", "flamenco", shot, "--preset", "farm.toml", "--chunk", common.CHUNK]
        common.run([binary, *farm, "--command", binary], desk)
        tasks = compiled(desk, shot)
        names = [task["name"] for task in tasks]
        expected = ["simulate 1-24", *[f"{verb} {frames}" for verb in ["mesh", "volume"]
                                       for frames in ["1-6", "7-12", "13-18", "19-24"]], "verify"]
        if names != expected or tasks[-1]["after"] != list(range(1, 9)):
            sys.exit(f"other tasks than expected: {names}")
        running = Farm(tasks, desk)
        workers = running.run()
        common.kill_worker(shot, ["--frames", "13-18"], shot / "mesh/liquid_0013.ply")
        before = common.made(shot)
        for worker in workers:
            worker.join()
        if [(name, code) for name, code, _ in running.failures] not in [[("mesh 13-18", -9)], [("volume 13-18", -9)]]:
            sys.exit(f"expected one killed task: {running.failures}")
        again = [name for name in before if before[name] != common.made(shot)[name]]
        if len(again) > 2:
            sys.exit(f"made again although they were complete: {again}")
        common.expect_same(common.content(shot), local, "Flamenco")
        print(f"flamenco: {running.failures[0][0]} killed, {len(again)} meshes made again; equal to the local run")

        # Chunks are those that the other engines get.
        for frames in ["1-24x3", "1,5,9-12,20", "2-23x7", "7"]:
            common.run([binary, "farm", "flamenco", shot, "--frames", frames, "--chunk", 3], desk)
            common.run([binary, "farm", "openjd", shot, "--frames", frames, "--chunk", 3], desk)
            template = json.loads((shot / "farm.openjd.json").read_text())
            mesh = next(step for step in template["steps"] if step["name"] == "mesh")
            chunks = mesh["parameterSpace"]["taskParameterDefinitions"][0]["range"]
            found = [task["name"].split()[1] for task in compiled(desk, shot) if task["name"].startswith("mesh")]
            if found != chunks:
                sys.exit(f"{frames}: found chunks {found}, expected {chunks}")

        # The limit of memory is that of the tasks that take memory, as on the other engines.
        common.run([binary, "farm", "flamenco", shot, "--max-memory", "2GiB"], desk)
        for task in compiled(desk, shot):
            words, is_limited = task["commands"][0]["parameters"]["args"], not task["name"].startswith("verify")
            if ("--max-memory" in words) != is_limited or (is_limited and f"{2 << 30}B" not in words):
                sys.exit(f"{task['name']}: another limit of memory than expected: {words}")

        # Wedges, and a path that Flamenco would change.
        wedge = ["wedge", "farm.toml", "--set", "liquid.spacing=0.08,0.1", "-o", "wedges", "--prepare"]
        common.run([binary, *wedge], desk)
        common.run([binary, "farm", "flamenco", "wedges", "--chunk", 12, "--command", binary], desk)
        tasks = compiled(desk, desk / "wedges")
        if len(tasks) != 2 * (1 + 2 + 2 + 1) + 1 or tasks[-1]["name"] != "contact sheet":
            sys.exit(f"other tasks of wedges than expected: {[task['name'] for task in tasks]}")
        for worker in Farm(tasks, desk).run():
            worker.join()
        if not (desk / "wedges/contact-sheet.png").exists():
            sys.exit("wedges: no contact sheet")
        refused = common.run([binary, "farm", "flamenco", desk / "{a}", "--preset", "farm.toml"], desk, 2)
        if "Flamenco takes for a variable" not in refused:
            sys.exit(f"a brace was not refused: {refused}")
        print("flamenco: chunks as of the other engines, two wedges, braces refused")


if __name__ == "__main__":
    main()
