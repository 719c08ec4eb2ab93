#!/usr/bin/env python3
"""Runs the job of a shot with Slurm on this machine, kills one worker, and compares the result with a local run.

    tools/farm/slurm.py [--binary MENISCUS]

Needs Debian's packages slurm-wlm and munge, and must be run as root: it starts `munged`, `slurmctld` and `slurmd` with a
configuration of its own in a temporary folder, and ends these processes again. Exits with 1 at the first difference, with 77
where Slurm is not installed.
"""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

import common

CONFIG = """
ClusterName=one
SlurmctldHost={host}
AuthType=auth/munge
AuthInfo=socket={place}/munge.socket
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
SlurmctldPort={port}
SlurmdPort={next_port}
StateSaveLocation={place}/state
SlurmdSpoolDir={place}/spool
SlurmctldPidFile={place}/slurmctld.pid
SlurmdPidFile={place}/slurmd.pid
SlurmctldLogFile={place}/slurmctld.log
SlurmdLogFile={place}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_interval=2
ReturnToService=2
MpiDefault=none
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


class Cluster:
    """One machine as a cluster."""

    def __init__(self, place):
        self.place, self.running = place, []
        host = os.uname().nodename.split(".")[0]
        port = 20000 + os.getpid() % 20000
        text = CONFIG.format(place=place, host=host, port=port, next_port=port + 1, cpus=os.cpu_count())
        for folder in ["state", "spool"]:
            (place / folder).mkdir()
        (place / "slurm.conf").write_text(text)
        (place / "munge.key").write_bytes(os.urandom(128))
        (place / "munge.key").chmod(0o400)
        place.chmod(0o755)
        self.env = {**os.environ, "SLURM_CONF": str(place / "slurm.conf")}
        self.start("munged", "--foreground", "--force", f"--key-file={place}/munge.key", f"--socket={place}/munge.socket",
                   f"--pid-file={place}/munged.pid", f"--log-file={place}/munged.log", f"--seed-file={place}/munged.seed")
        common.wait_for((place / "munge.socket").exists, "munged", 30)
        self.start("slurmctld", "-D")
        self.start("slurmd", "-D", "-N", host)
        common.wait_for(lambda: "idle" in self.run("sinfo", "-h", "-o", "%T", code=None), "an idle node", 60)

    def start(self, *command):
        path = shutil.which(command[0], path=os.environ["PATH"] + ":/usr/sbin")
        log = (self.place / f"{command[0]}.out").open("w")
        self.running.append(subprocess.Popen([path, *command[1:]], env=self.env, stdout=log, stderr=log))

    def run(self, *command, code=0, cwd=None):
        return common.run(command, cwd, code, env=self.env)

    def submit(self, shot, *options):
        """Submits a shot and waits for its jobs; returns what `sacct` would: the states by `scontrol`."""
        output = self.run("sh", str(shot / "farm.slurm.sh"), *options)
        common.wait_for(lambda: not self.run("squeue", "-h", "-o", "%i").split(), "the jobs", 400)
        return output

    def stop(self):
        for process in reversed(self.running):
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--binary", type=pathlib.Path, default=common.ROOT / "target/release/meniscus")
    binary = parser.parse_args().binary.resolve()
    if not shutil.which("sbatch") or os.geteuid() != 0:
        print("LEFT OUT: Slurm is not installed (slurm-wlm, munge), or this is not root")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as place:
        desk = pathlib.Path(place).resolve()
        local = common.local_run(binary, desk)
        (desk / "cluster").mkdir()
        cluster = None
        try:
            cluster = Cluster(desk / "cluster")
            check(cluster, binary, desk, local)
        finally:
            if cluster:
                cluster.stop()


def check(cluster, binary, desk, local):
    """The job, with a worker killed, with the whole task killed, and of wedges."""
    shot = desk / common.AWKWARD
    farm = ["--threads", 1, "farm", "slurm", shot, "--chunk", common.CHUNK, "--command", binary]
    common.run([binary, *farm, "--preset", "farm.toml"], desk)

    # A worker that is killed runs again in its task.
    start = time.monotonic()
    running = subprocess.Popen(["sh", str(shot / "farm.slurm.sh")], env=cluster.env, stdout=subprocess.DEVNULL)
    common.kill_worker(shot, ["--frames", "13-18"], shot / "mesh/liquid_0013.ply")
    running.wait()
    before = common.made(shot)
    common.wait_for(lambda: not cluster.run("squeue", "-h", "-o", "%i").split(), "the jobs", 400)
    logs = {path.name: path.read_text() for path in (shot / "farm-log").iterdir()}
    killed = [name for name, text in logs.items() if "ended by signal 9; attempt 2 of 3" in text]
    if len(killed) != 1:
        sys.exit(f"expected one killed task: {killed} of {sorted(logs)}")
    again = [name for name in before if before[name] != common.made(shot)[name]]
    if len(again) > 1 or not any("valid" in text for name, text in logs.items() if name.startswith("verify")):
        sys.exit(f"made again: {again}; logs: {sorted(logs)}")
    common.expect_same(common.content(shot), local, "Slurm")
    seconds = time.monotonic() - start
    print(f"slurm: worker of {killed[0]} killed, {len(again)} meshes made again; equal to the local run, {seconds:.0f} s")

    # A task that is lost with its script costs its chunk; submitted again, the job makes only that.
    shutil.rmtree(shot / "mesh")
    shutil.rmtree(shot / "farm-log")
    (shot / "mesh.jsonl").unlink()
    running = subprocess.Popen(["sh", str(shot / "farm.slurm.sh")], env=cluster.env, stdout=subprocess.DEVNULL)
    common.wait_for((shot / "mesh/liquid_0013.ply").exists, "a mesh of the third chunk")
    tasks = cluster.run("squeue", "-h", "-r", "-n", "meniscus-mesh", "-o", "%i").split()
    third = [task for task in tasks if task.endswith("_3")]
    cluster.run("scancel", "--signal=KILL", "--full", *third)
    running.wait()
    common.wait_for(lambda: not cluster.run("squeue", "-h", "-o", "%i").split(), "the jobs", 400)
    before = common.made(shot)
    if third and len(before) >= 24:
        sys.exit("the task was not lost")
    cluster.submit(shot)
    after = common.made(shot)
    again = [name for name in before if before[name] != after[name]]
    common.expect_same(common.content(shot), local, "Slurm, submitted again")
    print(f"slurm: a lost task cost {24 - len(before)} of 24 meshes; submitted again, equal to the local run ({len(again)} made twice)")

    # Wedges: each is a chain of jobs, and the contact sheet comes last.
    wedge = ["wedge", "farm.toml", "--set", "liquid.spacing=0.08,0.1", "-o", "wedges", "--prepare"]
    common.run([binary, *wedge], desk)
    common.run([binary, "--threads", 1, "farm", "slurm", "wedges", "--chunk", 12, "--command", binary], desk)
    output = cluster.submit(desk / "wedges", "--nice=10")
    if not (desk / "wedges/contact-sheet.png").exists() or len(re.findall("submitted", output)) != 3:
        sys.exit(f"wedges: no contact sheet\n{output}")
    common.run([binary, "verify", "wedges/spacing-0p1"], desk)
    print("slurm: two wedges and their contact sheet")


if __name__ == "__main__":
    main()
