#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Runs clippy and rustdoc on what the tests are compiled from, without compiling dependencies a second time for it.

    export RUSTC_WORKSPACE_WRAPPER=$PWD/tools/lint.py
    cargo test --no-run        # compiles, and records how each crate of the package is compiled
    tools/lint.py              # lints these crates, and the benches; warnings are errors

`cargo clippy` and `cargo doc` read dependencies in another form than the tests, which takes two minutes of processor time."""

import hashlib
import json
import os
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

TARGET = Path(os.environ.get("CARGO_TARGET_DIR", "target"))
RECORDS = TARGET / "lint"
# What cargo adds for itself, with the value that follows if there is one.
FOR_CARGO = ("--error-format", "--json", "--diagnostic-width", "--emit", "--out-dir")
# For crates of tests alone: smaller functions, which compile in less time than they run longer (docs/build.md).
FEWER_INLINED = ["-Cllvm-args=-inline-threshold=60 -inlinehint-threshold=100", "-Cno-vectorize-slp"]
DENIED = {"CLIPPY_ARGS": "-D__CLIPPY_HACKERY__warnings__CLIPPY_HACKERY__"}


def value_of(arguments: list[str], name: str) -> str:
    return arguments[arguments.index(name) + 1]


def record_and_compile(arguments: list[str]) -> None:
    """Stands for rustc: notes the arguments of a crate, and runs it."""
    if "--crate-name" in arguments and value_of(arguments, "--crate-name") != "___":
        source = next(argument for argument in arguments if argument.endswith(".rs"))
        # A library for other languages has no hash in its name.
        hashed = next((argument for argument in arguments if argument.startswith("extra-filename=")), "")
        name = value_of(arguments, "--crate-name") + hashed.removeprefix("extra-filename=")
        names = {key for key in os.environ if key.startswith("CARGO_") or key == "OUT_DIR"} - {"CARGO_MAKEFLAGS"}
        record = {"arguments": arguments, "source": source, "environment": {key: os.environ[key] for key in names}}
        RECORDS.mkdir(parents=True, exist_ok=True)
        (RECORDS / f"{name}.json").write_text(json.dumps(record))
        arguments += FEWER_INLINED if "--test" in arguments else []
    os.execvp(arguments[0], arguments)


def for_people(arguments: list[str]) -> list[str]:
    """The arguments of rustc without those that make it write for cargo."""
    kept, rest = [], arguments[1:]
    while rest:
        argument, rest = rest[0], rest[1:]
        if argument in FOR_CARGO or (argument == "-C" and rest[0].startswith("incremental=")):
            rest = rest[1:]
        elif argument.split("=")[0] not in FOR_CARGO:
            kept.append(argument)
    return kept


def clippy(record: dict) -> subprocess.CompletedProcess:
    out = RECORDS / "metadata" / record["source"].replace("/", "-")
    out.mkdir(parents=True, exist_ok=True)
    command = ["clippy-driver", "rustc", *for_people(record["arguments"]), "--emit=metadata", f"--out-dir={out}"]
    return run(command, record, DENIED)


def rustdoc(record: dict) -> subprocess.CompletedProcess:
    """Documents the library, whose record it is."""
    arguments, kept = for_people(record["arguments"]), []
    for option, value in zip(arguments, arguments[1:] + [""]):
        if option in ("-L", "--extern", "--cfg", "--check-cfg", "--crate-name"):
            kept += [option, value]
        elif option.startswith(("--edition", "--cfg=", "--extern=")) or option == record["source"]:
            kept.append(option)
    # Cargo does not give these to rustc.
    lints = tomllib.loads(Path("Cargo.toml").read_text())["lints"]["rustdoc"]
    levels = [f"--{level}=rustdoc::{lint}" for lint, level in lints.items()]
    return run(["rustdoc", *kept, "-D", "warnings", *levels, "-o", str(RECORDS / "doc")], record, {})


def run(command: list[str], record: dict, more: dict[str, str]) -> subprocess.CompletedProcess:
    environment = os.environ | record["environment"] | more
    return subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def compiled() -> set[str]:
    """The names of the files that `cargo test` uses of the package; it compiles those that are not fresh."""
    command = ["cargo", "test", "--no-run", "--quiet", "--message-format=json"]
    lines = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout.splitlines()
    messages = [json.loads(line) for line in lines if line.startswith("{")]
    return {Path(file).name for message in messages for file in message.get("filenames", [])}


def digest(records: list[dict]) -> str:
    """Of all that the lints depend on: the compiler, this program, the arguments and the files that each crate was made from."""
    text = subprocess.run(["rustc", "--version", "--verbose"], stdout=subprocess.PIPE, check=True).stdout
    total = hashlib.sha256(text + json.dumps(records, sort_keys=True).encode())
    files = {Path(__file__), *Path(".").glob("*.toml"), *Path(".").glob(".clippy.toml"), *Path("benches").rglob("*.rs"), *(Path(record["source"]) for record in records)}
    for record in records:
        arguments = record["arguments"]
        hashed = next((argument for argument in arguments if argument.startswith("extra-filename=")), "")
        name = value_of(arguments, "--crate-name") + hashed.removeprefix("extra-filename=")
        # What rustc read, one file in a line that ends in a colon.
        for line in (Path(value_of(arguments, "--out-dir")) / f"{name}.d").read_text().splitlines():
            if line.endswith(":"):
                files.add(Path(line[:-1].replace("\\ ", " ")))
    for path in sorted(files):
        total.update(f"{path}\n".encode() + hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


def main() -> int:
    # There may be records of other features and folders: those of now are among the files in use, or are linked with one.
    files = compiled()
    records = []
    for path in sorted(RECORDS.glob("*.json")):
        record = json.loads(path.read_text())
        linked = [Path(argument.split("=")[-1]).name for argument in record["arguments"] if argument.startswith("meniscus=")]
        if files & {path.stem, f"lib{path.stem}.rlib", *linked} and Path(record["source"]).is_file():
            records.append(record)
    passed, state = RECORDS / "passed", digest(records)
    if passed.is_file() and passed.read_text() == state:
        print("unchanged since these lints passed")
        return 0
    library = [record for record in records if record["source"] == "src/lib.rs" and "--test" not in record["arguments"]]
    example = [record for record in records if record["source"].startswith("examples/")]
    if not library or not example:
        print(f"{RECORDS}: no records of the library and an example; compile the tests with RUSTC_WORKSPACE_WRAPPER={sys.argv[0]}")
        return 1
    # Benches have the dependencies of examples.
    for bench in sorted(Path("benches").glob("*.rs")):
        changed = {example[0]["source"]: str(bench), value_of(example[0]["arguments"], "--crate-name"): bench.stem}
        arguments = [changed.get(argument, argument) for argument in example[0]["arguments"]]
        records.append(example[0] | {"arguments": arguments, "source": str(bench)})
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        jobs = [pool.submit(rustdoc, library[0]), *(pool.submit(clippy, record) for record in records)]
        results = [job.result() for job in jobs]
    for result in results:
        print(result.stdout, end="")
    failed = any(result.returncode for result in results)
    if not failed:
        passed.write_text(state)
    return int(failed)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        record_and_compile(sys.argv[1:])
    sys.exit(main())
