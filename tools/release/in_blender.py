# SPDX-License-Identifier: MIT OR Apache-2.0
"""Installs the extension with its wheels in Blender, and runs the engine: from the zip that tools/release/build wrote, as when it is
dropped on Blender's window, and from the repository next to it.

    PYTHON tools/release/in_blender.py target/wheels/blender

PYTHON has bpy. Works in fresh user folders; nothing is downloaded: `unshare --net` before it shows so. The index is compared with
that of Blender's own command.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path


def install_zip(folder: Path) -> str:
    """Installs the zip as Blender does when it is dropped on its window; returns the module of its add-on."""
    import bpy

    (path,) = folder.glob("*.zip")
    bpy.ops.extensions.package_install_files(filepath=str(path), repo="user_default", enable_on_install=True)
    return "bl_ext.user_default.meniscus"


def install_from_repository(folder: Path) -> str:
    """Installs the extension from the repository in the folder; returns the module of its add-on."""
    import bpy

    repositories = bpy.context.preferences.extensions.repos
    # A repository on a web server is remote; a folder is one as well, by its URL.
    repository = repositories.new(name="Meniscus", module="meniscus_test", remote_url=(folder / "index.json").as_uri())
    repository.use_remote_url = True
    index = list(repositories).index(repository)
    bpy.ops.extensions.repo_sync(repo_index=index)
    # Blender takes any URL for the network, also one of a folder.
    bpy.context.preferences.system.use_online_access = True
    bpy.ops.extensions.package_install(repo_index=index, pkg_id="meniscus", enable_on_install=True)
    bpy.context.preferences.system.use_online_access = False
    return "bl_ext.meniscus_test.meniscus"


INSTALLERS = {"zip": install_zip, "repository": install_from_repository}


def install(folder: Path, source: str) -> None:
    """Runs in Blender: the extension of the folder is installed, and the engine in the extension makes a shot."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    print("Blender", bpy.app.version_string, "installs from the", source, flush=True)
    bpy.ops.preferences.addon_enable(module="bl_pkg")
    addon = INSTALLERS[source](folder)

    import numpy

    import meniscus_fx as mf

    place = Path(mf.__file__).resolve()
    assert Path(os.environ["BLENDER_USER_RESOURCES"]).resolve() in place.parents, place
    assert addon in bpy.context.preferences.addons, f"the add-on {addon} is not enabled"
    print("installed", place.parent, oct(mf.program().stat().st_mode), flush=True)
    mesh = mf.reconstruct(numpy.zeros((1, 3), numpy.float32), 0.1)
    assert mesh.is_sound and len(mesh.triangles) > 0
    with tempfile.TemporaryDirectory() as work:
        shot = mf.shot("dam-break", Path(work) / "shot", quality="draft", frames="1-3")
        assert len(shot.meshes) == 3
        # What was made is opened, by the add-on that was installed.
        bpy.ops.import_scene.meniscus_shot(filepath=str(shot.folder / "shot.json"), studio=False)
        vertices = len(bpy.context.object.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.vertices)
        assert vertices > 1000, vertices
    print(f"{mf.run('--version').strip()}: simulated, meshed and imported {vertices} vertices", flush=True)
    # Blender as a module does not always end well.
    os._exit(0)


def same_index(folder: Path, work: Path) -> None:
    """Compares the index with what Blender's command makes of the same zip."""
    import bpy

    command = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    shutil.copytree(folder, work, ignore=shutil.ignore_patterns("index.json"))
    subprocess.run([sys.executable, command, "server-generate", "--repo-dir", work], check=True)
    ours, theirs = (json.loads((place / "index.json").read_text(encoding="utf-8")) for place in (folder, work))
    assert ours == theirs, f"found {ours}\nexpected, from Blender's server-generate, {theirs}"
    print("index.json is that of Blender's server-generate", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="the folder with the zip and index.json")
    parser.add_argument("--inside", choices=INSTALLERS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    folder = options.folder.resolve()
    if options.inside:
        return install(folder, options.inside)
    with tempfile.TemporaryDirectory() as work:
        for source in INSTALLERS:
            user = Path(work) / source
            user.mkdir()
            environment = os.environ | {"BLENDER_USER_RESOURCES": str(user), "PYTHONDONTWRITEBYTECODE": "1"}
            # No PYTHONPATH: the package is the one of the extension.
            environment.pop("PYTHONPATH", None)
            subprocess.run([sys.executable, __file__, "--inside", source, str(folder)], check=True, env=environment, cwd=work)
        same_index(folder, Path(work) / "again")


if __name__ == "__main__":
    main()
