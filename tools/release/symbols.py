# SPDX-License-Identifier: MIT OR Apache-2.0
"""What the files for a system need of it, read from their headers: nothing newer than the wheel's tag promises.

Needs lief.
"""

import hashlib
import struct
from pathlib import Path

import lief

import wheel
from platforms import Platform

# Libraries that every system of the kind has: for Linux those of the manylinux policy, for Windows those of Windows 10.
LINUX = {"libc.so.6", "libm.so.6", "libdl.so.2", "libpthread.so.0", "libgcc_s.so.1", "librt.so.1"}
LINUX_LOADERS = {"ld-linux-x86-64.so.2", "ld-linux-aarch64.so.1"}
WINDOWS = {
    "advapi32.dll", "bcrypt.dll", "bcryptprimitives.dll", "kernel32.dll", "ntdll.dll", "shell32.dll", "user32.dll",
    "userenv.dll", "ws2_32.dll",
}  # fmt: skip
MACOS = ("/usr/lib/libSystem.B.dylib", "/usr/lib/libcharset.1.dylib", "/usr/lib/libiconv.2.dylib", "/System/Library/Frameworks/")
MACHINES = {
    "linux-x64": lief.ELF.ARCH.X86_64,
    "linux-arm64": lief.ELF.ARCH.AARCH64,
    "macos-arm64": lief.MachO.Header.CPU_TYPE.ARM64,
    "macos-x64": lief.MachO.Header.CPU_TYPE.X86_64,
    "windows-x64": lief.PE.Header.MACHINE_TYPES.AMD64,
}


def check(platform: Platform, path: Path, machine_paths: list[str]) -> list[str]:
    """What is wrong with a file for a system; nothing if it is fine."""
    kind = platform.name.split("-")[0]
    found = {"linux": elf, "macos": macho, "windows": pe}[kind](platform, path)
    if not found and path.name == platform.library:
        found += functions(path)
    data = path.read_bytes()
    leaks = [text for text in machine_paths if text.encode() in data]
    return [f"{path.name}: {problem}" for problem in [*found, *(f"found the path {text} of this machine" for text in leaks)]]


def functions(path: Path) -> list[str]:
    """Functions that the Python side calls and a library does not export."""
    binary = lief.parse(str(path))
    if isinstance(binary, lief.PE.Binary):
        exported = {str(entry.name) for entry in binary.get_export().entries} if binary.has_exports else set()
    else:
        # Names of C begin with a line on macOS.
        exported = {str(symbol.name).removeprefix("_") for symbol in binary.exported_symbols}
    missing = wheel.called_functions() - exported
    return [f"does not export {name}, which meniscus_fx/_native.py calls" for name in sorted(missing)]


def elf(platform: Platform, path: Path) -> list[str]:
    binary = lief.ELF.parse(str(path))
    if binary is None or binary.header.machine_type != MACHINES[platform.name]:
        return ["is no file for this processor"]
    problems = [f"needs {name}, which not every Linux has" for name in binary.libraries if name not in LINUX | LINUX_LOADERS]
    for requirement in binary.symbols_version_requirement:
        for auxiliary in requirement.get_auxiliary_symbols():
            if not platform.has_glibc(auxiliary.name) and platform.floor:
                problems.append(f"needs {auxiliary.name}, expected at most glibc {platform.floor[0]}.{platform.floor[1]}")
    return problems


def pe(platform: Platform, path: Path) -> list[str]:
    binary = lief.PE.parse(str(path))
    if binary is None or binary.header.machine != MACHINES[platform.name]:
        return ["is no file for this processor"]
    names = [entry.name.lower() for entry in [*binary.imports, *binary.delay_imports]]
    expected = lambda name: name in WINDOWS or name.startswith("api-ms-win-")  # noqa: E731
    return [f"needs {name}, which not every Windows has" for name in names if not expected(name)]


def macho(platform: Platform, path: Path) -> list[str]:
    fat = lief.MachO.parse(str(path))
    if fat is None or fat.size != 1 or fat.at(0).header.cpu_type != MACHINES[platform.name]:
        return ["is no file for this processor"]
    binary = fat.at(0)
    problems = [f"needs {entry.name}, which not every macOS has" for entry in binary.libraries
                if not entry.name.startswith((*MACOS, "@rpath/"))]  # fmt: skip
    oldest = binary.build_version.minos if binary.has_build_version else binary.version_min.version
    if platform.floor and tuple(oldest[:2]) > platform.floor:
        problems.append(f"needs macOS {oldest[0]}.{oldest[1]}, expected at most {platform.floor[0]}.{platform.floor[1]}")
    # Processors of Apple run no program without a signature; without a developer's, one by its own content ("ad hoc").
    if platform.name == "macos-arm64":
        problems += signature(binary, path.read_bytes())
    return problems


# Numbers of Apple's format of code signatures, all big-endian.
SUPER_BLOB, CODE_DIRECTORY, SHA256 = 0xFADE0CC0, 0xFADE0C02, 2


def signature(binary: lief.MachO.Binary, data: bytes) -> list[str]:
    """Whether the signature's hashes are those of the file's pages: a tool that changed it afterwards is found."""
    if not binary.has_code_signature:
        return ["has no code signature"]
    start = binary.code_signature.data_offset
    magic, _, count = struct.unpack_from(">III", data, start)
    if magic != SUPER_BLOB:
        return ["has a damaged code signature"]
    for index in range(count):
        (offset,) = struct.unpack_from(">I", data, start + 12 + 8 * index + 4)
        at = start + offset
        if struct.unpack_from(">I", data, at)[0] != CODE_DIRECTORY:
            continue
        hashes, _, _, pages, limit = struct.unpack_from(">IIIII", data, at + 16)
        size, kind, _, page = struct.unpack_from(">BBBB", data, at + 36)
        if kind != SHA256 or limit != start:
            return [f"has a code signature of kind {kind} for {limit} bytes, expected SHA-256 for {start}"]
        for number in range(pages):
            expected = data[at + hashes + number * size :][:size]
            content = data[number << page : min((number + 1) << page, limit)]
            if hashlib.sha256(content).digest() != expected:
                return [f"has a code signature that does not fit page {number}"]
        return []
    return ["has no hashes in its code signature"]
