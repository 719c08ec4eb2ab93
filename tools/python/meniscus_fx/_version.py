# SPDX-License-Identifier: MIT OR Apache-2.0
"""The package's version: that of Cargo.toml, which tools/release/wheel.py compares."""

VERSION = "0.1.0"
