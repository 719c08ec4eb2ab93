# SPDX-License-Identifier: MIT OR Apache-2.0
"""`python -m meniscus_fx` is the command `meniscus`."""

from ._program import main

main()
