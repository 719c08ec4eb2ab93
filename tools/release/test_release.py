# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests what tools/release packs, without compiling: licences, the list of packages, the archive, the extension's manifest."""

import ast
import dataclasses
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
import unittest
import zipfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))

import extension  # noqa: E402
import licences  # noqa: E402
import wheel  # noqa: E402
from platforms import PLATFORMS  # noqa: E402

LINUX = PLATFORMS["linux-x64"]


class Licences(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.shipped = licences.packages(LINUX.target)

    def one(self, **changes):
        return dataclasses.replace(next(package for package in self.shipped if package.name == "rayon"), **changes)

    def test_expressions_are_choices(self):
        self.assertEqual(licences.parse("MIT/Apache-2.0"), [["MIT"], ["Apache-2.0"]])
        self.assertEqual(licences.parse("(MIT OR Apache-2.0) AND Unicode-3.0"), [["MIT", "Unicode-3.0"], ["Apache-2.0", "Unicode-3.0"]])
        self.assertEqual(licences.parse("A WITH B OR C AND D"), [["A WITH B"], ["C", "D"]])
        for wrong in ["", "MIT OR", "(MIT", "MIT Apache-2.0", "AND MIT"]:
            with self.assertRaises(licences.LicenceError, msg=wrong):
                licences.parse(wrong)

    def test_a_licence_that_is_not_allowed_stops_the_build(self):
        self.assertEqual(licences.chosen(self.one(licence="GPL-3.0-only OR MIT")), ["MIT"])
        for licence in ["GPL-3.0-only", "MIT AND GPL-3.0-only", ""]:
            with self.assertRaisesRegex(licences.LicenceError, "rayon"):
                licences.chosen(self.one(licence=licence))

    def test_a_missing_text_stops_the_build(self):
        with tempfile.TemporaryDirectory() as folder, self.assertRaisesRegex(licences.LicenceError, "no text of its licence"):
            licences.texts(self.one(folder=Path(folder)))

    def test_every_package_has_its_licence_and_only_what_is_shipped_is_listed(self):
        text = licences.third_party(self.shipped)
        # Of C libraries inside of packages, below the top of their archives.
        for author in ("Yann Collet", "Francesc Alted", "Meta Platforms"):
            self.assertIn(author, text)
        names = {package.name for package in self.shipped}
        for package in self.shipped:
            self.assertIn(f"\n{package.name} {package.version} (", text)
        self.assertTrue({"meniscus", "meniscus-python", "rayon", "zstd-sys", "lz4-sys", "blosc-src", "std"} <= names)
        # Of tests, and of what only compiles.
        self.assertFalse({"proptest", "criterion", "syn", "cc", "serde_derive"} & names)

    def test_what_the_linker_adds_is_listed_for_the_targets_that_have_it(self):
        expected = {
            "linux-x64": {"llvm-libunwind", "zig-compiler-rt"},
            "windows-x64": {"llvm-libunwind", "mingw-w64", "zig-compiler-rt"},
            "macos-arm64": {"zig-compiler-rt"},
        }
        for name, names in expected.items():
            self.assertEqual({package.name for package in licences.runtimes(PLATFORMS[name].target)}, names)
        self.assertLessEqual(expected["linux-x64"], {package.name for package in self.shipped})
        windows = licences.runtimes(PLATFORMS["windows-x64"].target)
        text = licences.third_party(windows)
        for part in (f"mingw-w64 zig-{licences.ZIG}: ZPL-2.1", "Copyright (c) 2009 - 2013 by the mingw-w64 project", "LLVM Exceptions", "Zig contributors"):
            self.assertIn(part, text)
        self.assertIn("ZPL-2.1", licences.expression(windows))
        with tempfile.TemporaryDirectory() as folder:
            for name, runtime in licences.RUNTIMES.items():
                path = Path(folder) / runtime.text
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes((licences.HERE / "licences" / f"{name}.txt").read_bytes())
            self.assertEqual(licences.compare_with_zig(Path(folder)), [])
            path.write_text("another text")
            self.assertEqual(licences.compare_with_zig(Path(folder)), [name])

    def test_the_list_of_packages_is_complete(self):
        text = licences.sbom(self.shipped, "1.2.3")
        self.assertEqual(text, licences.sbom(self.shipped, "1.2.3"))
        bom = json.loads(text)
        known = {component["bom-ref"] for component in bom["components"]} | {bom["metadata"]["component"]["bom-ref"]}
        self.assertEqual({edge["ref"] for edge in bom["dependencies"]}, known)
        self.assertLessEqual({ref for edge in bom["dependencies"] for ref in edge["dependsOn"]}, known)
        rayon = next(component for component in bom["components"] if component["name"] == "rayon")
        self.assertRegex(rayon["hashes"][0]["content"], "^[0-9a-f]{64}$")


class Archive(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        for name in (LINUX.program, LINUX.library):
            (self.folder / name).write_bytes(name.encode() * 100)

    def test_a_wheel_has_the_same_bytes_twice_and_records_every_file(self):
        first, second = (wheel.pack(LINUX, self.folder, self.folder / name, compression=8) for name in ("one", "two"))
        self.assertEqual(first.read_bytes(), second.read_bytes())
        self.assertEqual(first.name, f"meniscus_fx-{wheel.version()}-py3-none-manylinux_2_28_x86_64.whl")
        with zipfile.ZipFile(first) as archive:
            names = archive.namelist()
            record = next(name for name in names if name.endswith("/RECORD"))
            listed = [line.rsplit(",", 2) for line in archive.read(record).decode().splitlines()]
            self.assertEqual([name for name, *_ in listed], names)
            for name, digest, size in listed[:-1]:
                data = archive.read(name)
                self.assertEqual(len(data), int(size))
                expected = wheel.base64.urlsafe_b64encode(hashlib.sha256(data).digest()).decode().rstrip("=")
                self.assertEqual(digest, f"sha256={expected}", name)
            # What zip files otherwise take from the machine.
            self.assertEqual({(info.date_time, info.create_system) for info in archive.infolist()}, {(wheel.EPOCH, 3)})
            modes = {name: archive.getinfo(name).external_attr >> 16 for name in names}
            self.assertEqual(modes["meniscus_fx/bin/meniscus"], 0o100755)
            self.assertEqual(modes["meniscus_fx/_mesh.py"], 0o100644)
            metadata = archive.read(record.replace("RECORD", "METADATA")).decode()
        for name in re.findall("(?m)^License-File: (.*)$", metadata):
            self.assertIn(record.replace("RECORD", f"licenses/{name}"), names)
        self.assertIn("\nLicense-Expression: (MIT OR Apache-2.0) AND MIT AND Apache-2.0 AND ", metadata)

    def test_the_manifest_names_wheels_and_platforms(self):
        manifest = (licences.ROOT / "tools/blender/meniscus/blender_manifest.toml").read_text(encoding="utf-8")
        wheels = [Path(f"meniscus_fx-0.1.0-py3-none-{PLATFORMS[name].tag}.whl") for name in ("windows-x64", "linux-x64")]
        found = tomllib.loads(extension.with_wheels(manifest, wheels))
        self.assertEqual(found["platforms"], ["linux-x64", "windows-x64"])
        self.assertEqual(found["wheels"], sorted(f"./wheels/{path.name}" for path in wheels))
        self.assertIn("SPDX:BSD-3-Clause", found["license"])
        before = tomllib.loads(manifest)
        self.assertEqual({key: found[key] for key in before if key != "license"}, {key: before[key] for key in before if key != "license"})


class Crate(unittest.TestCase):
    def test_the_package_of_cargo_is_small(self):
        with tempfile.TemporaryDirectory() as folder:
            command = ["cargo", "package", "--quiet", "--locked", "--no-verify", "--allow-dirty", "-p", "meniscus"]
            subprocess.run([*command, "--target-dir", folder], cwd=licences.ROOT, check=True)
            (path,) = Path(folder).glob("package/*.crate")
            self.assertLess(path.stat().st_size, 2 << 20, "found bytes, expected less than 2 MiB: what is new in `include` of Cargo.toml?")


class Platforms(unittest.TestCase):
    def test_symbol_versions_that_the_oldest_glibc_lacks_are_found(self):
        cases = {"GLIBC_2.2.5": True, "GLIBC_2.28": True, "GLIBC_2.28.1": False, "GLIBC_2.29": False, "GLIBC_3.0": False, "GCC_3.3": True}
        cases |= {"GLIBC_ABI_DT_RELR": False, "GLIBC_PRIVATE": False, "GLIBC_": False}
        for version, has in cases.items():
            self.assertEqual(LINUX.has_glibc(version), has, version)

    def test_all_folders_of_a_machine_are_renamed(self):
        script = "import runpy, sys; build = runpy.run_path(sys.argv[1], run_name='build'); print('\\n'.join(build['machine_paths']()))"
        folders = {"CARGO_HOME": "/somewhere/cargo", "RUSTUP_HOME": "/elsewhere/rustup", "CARGO_TARGET_DIR": "/scratch/target"}
        command = [sys.executable, "-c", script, licences.HERE / "build"]
        found = subprocess.run(command, env=os.environ | folders, capture_output=True, text=True, check=True).stdout.splitlines()
        self.assertLessEqual({str(Path(path).absolute()) for path in folders.values()} | {str(licences.ROOT)}, set(found))


class Sources(unittest.TestCase):
    def test_the_package_has_the_syntax_of_its_oldest_python(self):
        oldest = re.search(r"Requires-Python: >=(\d+)\.(\d+)", wheel.metadata([])).groups()
        self.assertEqual(oldest, ("3", "9"))
        for path in wheel.PACKAGE.glob("*.py"):
            source = path.read_text(encoding="utf-8")
            ast.parse(source, path.name, feature_version=tuple(map(int, oldest)))
            # Else annotations such as `int | None` are evaluated, which 3.9 cannot.
            self.assertTrue("|" not in source or "from __future__ import annotations" in source, path.name)


class Interface(unittest.TestCase):
    def test_both_sides_and_windows_have_the_same_functions(self):
        native = licences.ROOT / "tools/python/native"
        exported = set((native / "exports.def").read_text().split()[1:])
        source = (native / "src/lib.rs").read_text()
        defined = set(re.findall(r'pub (?:unsafe )?extern "C" fn (\w+)', source))
        python = (licences.ROOT / "tools/python/meniscus_fx/_native.py").read_text()
        self.assertEqual((exported, wheel.called_functions()), (defined, defined))
        versions = [re.search(pattern, text).group(1) for pattern, text in ((r"const ABI: u32 = (\d+)", source), (r"ABI = (\d+)", python))]
        self.assertEqual(versions[0], versions[1])


if __name__ == "__main__":
    unittest.main()
