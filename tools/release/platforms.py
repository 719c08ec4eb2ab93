# SPDX-License-Identifier: MIT OR Apache-2.0
"""The systems that wheels are built for."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Platform:
    """A system: what cargo, wheels and Blender call it."""

    name: str
    """Name here, and in Blender's manifests."""
    target: str
    """Target of rustc."""
    linked_for: str
    """Target as cargo-zigbuild takes it: with the oldest glibc."""
    tag: str
    """Platform tag of wheels."""
    program: str
    library: str
    profile: str = "release"
    """Profile of Cargo.toml."""
    floor: tuple[int, int] | None = None
    """Oldest glibc or macOS that the files may need; None: not a matter of versions."""

    def has_glibc(self, version: str) -> bool:
        """Whether its oldest glibc has a symbol version such as GLIBC_2.17. It has none without a number: of these, GLIBC_PRIVATE
        is of one glibc alone, and GLIBC_ABI_DT_RELR requires 2.36."""
        family, _, number = version.partition("_")
        if family != "GLIBC" or self.floor is None:
            return True
        parts = number.split(".")
        return all(part.isdigit() for part in parts) and tuple(map(int, parts)) <= self.floor


# Link-time optimisation leaves out what nothing calls. Without it that is left to the linker, which does so for Linux; for Windows neither
# zig's nor GNU's does (libraries of 16.7 and 17.0 MB), for macOS zig's exports, and so keeps, everything (14.9 MB).
PLATFORMS = {
    platform.name: platform
    for platform in [
        Platform(
            "linux-x64", "x86_64-unknown-linux-gnu", "x86_64-unknown-linux-gnu.2.28", "manylinux_2_28_x86_64",
            "meniscus", "libmeniscus_native.so", floor=(2, 28),
        ),
        Platform(
            "linux-arm64", "aarch64-unknown-linux-gnu", "aarch64-unknown-linux-gnu.2.28", "manylinux_2_28_aarch64",
            "meniscus", "libmeniscus_native.so", floor=(2, 28),
        ),
        Platform(
            "windows-x64", "x86_64-pc-windows-gnu", "x86_64-pc-windows-gnu", "win_amd64",
            "meniscus.exe", "meniscus_native.dll", "dist",
        ),
        Platform(
            "macos-arm64", "aarch64-apple-darwin", "aarch64-apple-darwin", "macosx_11_0_arm64",
            "meniscus", "libmeniscus_native.dylib", "dist", (11, 0),
        ),
        Platform(
            "macos-x64", "x86_64-apple-darwin", "x86_64-apple-darwin", "macosx_10_15_x86_64",
            "meniscus", "libmeniscus_native.dylib", "dist", (10, 15),
        ),
    ]
}  # fmt: skip
