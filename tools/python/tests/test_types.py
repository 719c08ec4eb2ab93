# SPDX-License-Identifier: MIT OR Apache-2.0
"""Tests that everything public is typed and documented. Type checkers read the package in tools/release/check.py."""

import inspect
import pathlib
import unittest

import meniscus_fx as mf
from meniscus_fx import _mesh


def untyped(name, function):
    """The parameters, and `return`, of a function that have no type."""
    parameters = inspect.signature(function).parameters.values()
    missing = [f"{name}({each.name})" for each in parameters if each.name != "self" and each.annotation is each.empty]
    return missing + ([] if "return" in function.__annotations__ else [f"{name} -> return"])


class Types(unittest.TestCase):
    def test_everything_public_has_types_and_a_description(self):
        missing, count = [], 0
        for module in (mf, mf.cache):
            for name in getattr(module, "__all__", ("read", "read_header")):
                value = getattr(module, name)
                functions = {name: value} if inspect.isfunction(value) else {}
                if inspect.isclass(value):
                    # Those of dataclasses are made by Python.
                    members = [(key, each) for key, each in vars(value).items() if not key.startswith("_")]
                    functions = {f"{name}.{key}": each for key, each in members if inspect.isfunction(each)}
                    functions.update({f"{name}.{key}": each.fget for key, each in members if isinstance(each, property)})
                if functions or inspect.isclass(value):
                    missing += [] if inspect.getdoc(value) else [f"{name}: no description"]
                for key, function in functions.items():
                    missing += untyped(key, function)
                    count += 1
        self.assertEqual(missing, [])
        self.assertGreater(count, 12)

    def test_arrays_of_a_mesh_have_types(self):
        expected = {"vertices", "triangles", "normals", "attributes", "points", "point_radii", "point_attributes", "report"}
        self.assertEqual(set(_mesh.Mesh.__annotations__), expected)

    def test_the_package_declares_its_types(self):
        self.assertTrue((pathlib.Path(mf.__file__).parent / "py.typed").is_file())


if __name__ == "__main__":
    unittest.main()
