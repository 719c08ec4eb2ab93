# SPDX-License-Identifier: MIT OR Apache-2.0
"""The packages in a program: their licences, whose texts are gathered, and a list of them as CycloneDX JSON."""

import hashlib
import json
import os
import re
import subprocess
import tomllib
import uuid
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
# Licences of which a package has to offer one: all of them require no more than that their text is passed on.
ALLOWED = {
    "0BSD", "Apache-2.0", "Apache-2.0 WITH LLVM-exception", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "ISC", "MIT",
    "Unicode-3.0", "Unlicense", "ZPL-2.1", "Zlib",
}  # fmt: skip
FILES = re.compile(r"(?i)^(licen[cs]e|copying|copyright|notice|unlicense)([.-].*)?$")
# Files that are in a package's archive below its top, of C libraries that are compiled in.
INSIDE = {"lz4-sys": ["liblz4/lib/LICENSE"], "zstd-sys": ["zstd/LICENSE"]}
# Packages whose archives leave out the text, with the file here that has it.
MISSING = {"blosc-src": "blosc.txt"}
# Version of zig, which links the files for wheels, and has the sources of what it links into them.
ZIG = "0.17.1"


@dataclass(frozen=True)
class Runtime:
    """Parts of a system's or compiler's library that the linker adds."""

    licence: str
    text: str
    """Its licence inside of the package ziglang; `licences/NAME.txt` has the same content."""
    targets: tuple[str, ...]
    """Words of the targets that have it."""
    description: str


RUNTIMES = {
    "llvm-libunwind": Runtime(
        "Apache-2.0 WITH LLVM-exception", "lib/libunwind/LICENSE.TXT", ("linux", "windows"), "LLVM's library that unwinds the stack"
    ),
    "mingw-w64": Runtime("ZPL-2.1", "lib/libc/mingw/COPYING", ("windows",), "Start-up code and C library of mingw-w64 for Windows"),
    "zig-compiler-rt": Runtime("MIT", "LICENSE", ("linux", "windows", "darwin"), "Arithmetic that processors lack, of the compiler zig"),
}  # fmt: skip


class LicenceError(Exception):
    """A package may not be shipped as it is."""


@dataclass(frozen=True)
class Package:
    """A package that is compiled into the program or the library."""

    name: str
    version: str
    licence: str
    folder: Path
    checksum: str | None
    """SHA-256 of its archive; None for members of the workspace."""
    depends_on: tuple[str, ...]
    """Names and versions of packages."""
    description: str

    @property
    def purl(self) -> str:
        return f"pkg:{'generic' if self.name in RUNTIMES else 'cargo'}/{self.name}@{self.version}"


def packages(target: str) -> list[Package]:
    """What is compiled into the files for a target, in the order of names. What only compiles is not part of them."""
    command = ["cargo", "metadata", "--format-version=1", "--locked", "--filter-platform", target]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    by_id = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    locked = tomllib.loads((ROOT / "Cargo.lock").read_text(encoding="utf-8"))["package"]
    checksums = {(package["name"], package["version"]): package.get("checksum") for package in locked}

    def is_macro(identifier: str) -> bool:
        return any("proc-macro" in target["kind"] for target in by_id[identifier]["targets"])

    def dependencies(identifier: str) -> list[str]:
        found = nodes[identifier]["deps"]
        normal = [dep["pkg"] for dep in found if any(kind["kind"] is None for kind in dep["dep_kinds"])]
        return [dep for dep in normal if not is_macro(dep)]

    shipped, due = set(), list(metadata["workspace_members"])
    while due:
        identifier = due.pop()
        if identifier not in shipped:
            shipped.add(identifier)
            due += dependencies(identifier)
    found = []
    for identifier in shipped:
        package = by_id[identifier]
        names = sorted(f"{by_id[dep]['name']}@{by_id[dep]['version']}" for dep in dependencies(identifier))
        name, version = package["name"], package["version"]
        found.append(
            Package(
                name, version, package["license"] or "", Path(package["manifest_path"]).parent,
                checksums[name, version], tuple(names), package["description"] or "",
            )  # fmt: skip
        )
    return sorted([*found, standard_library(), *runtimes(target)], key=lambda package: (package.name, package.version))


def standard_library() -> Package:
    """Rust's own library, which every program has in it."""
    version = subprocess.run(["rustc", "--version"], check=True, capture_output=True, text=True).stdout.split()[1]
    sysroot = Path(subprocess.run(["rustc", "--print", "sysroot"], check=True, capture_output=True, text=True).stdout.strip())
    return Package("std", version, "MIT OR Apache-2.0", sysroot / "share" / "doc" / "rust", None, (), "Rust's standard library")


def runtimes(target: str) -> list[Package]:
    """What the linker adds to the files for a target."""
    added = {name: runtime for name, runtime in RUNTIMES.items() if set(runtime.targets) & set(target.split("-"))}
    return [Package(name, f"zig-{ZIG}", it.licence, HERE / "licences", None, (), it.description) for name, it in added.items()]


def compare_with_zig(folder: Path) -> list[str]:
    """The runtimes whose texts here are not those of the package ziglang in a folder."""
    names = []
    for name, runtime in RUNTIMES.items():
        here, there = (path.read_text(encoding="utf-8") for path in (HERE / "licences" / f"{name}.txt", folder / runtime.text))
        names += [name] if here != there else []
    return names


def parse(expression: str) -> list[list[str]]:
    """The choices of an SPDX expression, each as the licences that it needs."""
    # The slash is an old spelling of OR.
    tokens = re.findall(r"\(|\)|[^\s()]+", re.sub(r"(?<=\S)/(?=\S)", " OR ", expression))

    def choice(at: int) -> tuple[list[list[str]], int]:
        found, at = every(at)
        while at < len(tokens) and tokens[at] == "OR":
            more, at = every(at + 1)
            found = found + more
        return found, at

    def every(at: int) -> tuple[list[list[str]], int]:
        found, at = one(at)
        while at < len(tokens) and tokens[at] == "AND":
            more, at = one(at + 1)
            found = [left + right for left in found for right in more]
        return found, at

    def one(at: int) -> tuple[list[list[str]], int]:
        if at >= len(tokens) or tokens[at] in ("OR", "AND", "WITH", ")"):
            raise LicenceError(f"found the licence {expression!r}, expected an SPDX expression")
        if tokens[at] == "(":
            found, at = choice(at + 1)
            if at >= len(tokens) or tokens[at] != ")":
                raise LicenceError(f"found the licence {expression!r}, expected an SPDX expression")
            return found, at + 1
        if tokens[at + 1 : at + 2] == ["WITH"]:
            return [[" ".join(tokens[at : at + 3])]], at + 3
        return [[tokens[at]]], at + 1

    found, at = choice(0)
    if at != len(tokens):
        raise LicenceError(f"found the licence {expression!r}, expected an SPDX expression")
    return found


def chosen(package: Package) -> list[str]:
    """The licences under which a package is shipped: the first choice that is allowed, MIT before others."""
    try:
        choices = [choice for choice in parse(package.licence) if set(choice) <= ALLOWED]
    except LicenceError as error:
        raise LicenceError(f"{package.name} {package.version}: {error}") from None
    if not choices:
        known = ", ".join(sorted(ALLOWED))
        raise LicenceError(f"{package.name} {package.version}: found the licence {package.licence!r}, expected one of {known}")
    return min(choices, key=lambda choice: (choice != ["MIT"], choice != ["Apache-2.0"]))


def texts(package: Package) -> list[tuple[str, str]]:
    """The names and contents of a package's licence files."""
    if package.name in RUNTIMES:
        files = [package.folder / f"{package.name}.txt"]
    elif package.folder == ROOT or ROOT in package.folder.parents:
        files = [ROOT / "LICENSE-APACHE", ROOT / "LICENSE-MIT"]
    elif package.name == "std":
        # The page with the notices of what the library is made of, which the toolchain has with it.
        files = [package.folder / "COPYRIGHT-library.html", *(package.folder / "licenses" / f"{name}.txt" for name in ("MIT", "Apache-2.0"))]
    else:
        files = sorted(file for file in package.folder.iterdir() if FILES.match(file.name) and file.is_file())
        files += [package.folder / name for name in INSIDE.get(package.name, [])]
        files += [HERE / "licences" / MISSING[package.name]] if package.name in MISSING else []
    missing = [str(file) for file in files if not file.is_file()]
    if not files or missing:
        raise LicenceError(f"{package.name} {package.version}: found no text of its licence {' '.join(missing)}; add it to MISSING")
    return [(file.name, file.read_text(encoding="utf-8").replace("\r\n", "\n").strip()) for file in files]


def third_party(shipped: list[Package]) -> str:
    """The licences of all packages, every text once with the packages that it belongs to."""
    lines = [
        "Packages that are part of the program `meniscus` and its library, with their licences.",
        "Each is used under the licence named after it; the texts follow, each with the packages that have it.",
        "",
    ]
    owners: dict[str, list[str]] = {}
    for package in shipped:
        name = f"{package.name} {package.version}"
        lines.append(f"{name}: {' AND '.join(chosen(package))}")
        for file, text in texts(package):
            owners.setdefault(text, []).append(f"{name} ({file})")
    for text, names in sorted(owners.items(), key=lambda item: item[1]):
        lines += ["", "=" * 100, *names, "=" * 100, "", text]
    return "\n".join(lines) + "\n"


def expression(shipped: list[Package]) -> str:
    """The licence of a wheel: the project's own choice, and what its packages add to it."""
    more = {licence for package in shipped for licence in chosen(package)} - {"MIT", "Apache-2.0"}
    return " AND ".join(["(MIT OR Apache-2.0)", "MIT", "Apache-2.0", *sorted(more)])


def sbom(shipped: list[Package], version: str) -> str:
    """The packages as CycloneDX 1.6 JSON, the same text for the same packages."""
    root = {"type": "application", "bom-ref": f"pkg:pypi/meniscus-fx@{version}", "name": "meniscus-fx", "version": version}
    root |= {"purl": f"pkg:pypi/meniscus-fx@{version}", "licenses": [{"expression": expression(shipped)}]}
    components = []
    for package in shipped:
        entry = {"type": "library", "bom-ref": package.purl, "name": package.name, "version": package.version}
        entry |= {"purl": package.purl} if package.name != "std" else {}
        entry |= {"description": " ".join(package.description.split())} if package.description else {}
        entry |= {"licenses": [{"expression": package.licence.replace("/", " OR ")}]}
        entry |= {"hashes": [{"alg": "SHA-256", "content": package.checksum}]} if package.checksum else {}
        components.append(entry)
    members = [package.purl for package in shipped if package.checksum is None]
    edges = [{"ref": root["bom-ref"], "dependsOn": members}]
    edges += [{"ref": package.purl, "dependsOn": [f"pkg:cargo/{name}" for name in package.depends_on]} for package in shipped]
    body = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": root},
        "components": components,
        "dependencies": edges,
    }
    # A serial number by the content.
    digest = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).digest()
    body["serialNumber"] = f"urn:uuid:{uuid.UUID(bytes=digest[:16], version=4)}"
    return json.dumps(body, indent=1) + "\n"


if __name__ == "__main__":
    found = packages(os.environ.get("TARGET", "x86_64-unknown-linux-gnu"))
    print(third_party(found))
