# SPDX-License-Identifier: MIT OR Apache-2.0
"""Which object of a scene an asset was made of, also after it was renamed.

`assets/objects.json` has three marks of each object. Its `session_uid` is exact, survives renames and undo, and ends when a file is
loaded. The identifier that its role keeps survives saving and is lost by undo; copies have it, too, until the file is saved, but are made
after the file was loaded. Its name is the last resort.
"""

import uuid
from pathlib import Path

import bpy
from mathutils import Matrix

from ..messages import ShotError, printable
from . import assets
from .places import folder_of
from .sample import Sampled

# Custom property of a result: the identifier of the object that it stands for.
SOURCE = "meniscus_source"
# Names the time between two loaded files, in which a `session_uid` means one object.
session = uuid.uuid4().hex


# The largest `session_uid` of the objects that were loaded with the file: those of objects made later are larger. 0 if that is not known.
newest = 0


@bpy.app.handlers.persistent
def loaded(*_) -> None:
    global session, newest
    session = uuid.uuid4().hex
    newest = max((each.session_uid for each in bpy.data.objects), default=0)


@bpy.app.handlers.persistent
def saving(*_) -> None:
    """Takes the identifier from copies, which the saved file could not distinguish from their originals."""
    for scene in bpy.data.scenes:
        try:
            sources = Sources(folder_of(scene))
        except ShotError:
            continue
        for entry in sources.objects.values():
            marked = sources.marked(scene, entry)
            originals = sources.originals(marked, entry)
            for each in marked:
                if each not in originals and each.library is None:
                    each.meniscus.identifier = ""


def register() -> None:
    bpy.app.handlers.load_post.append(loaded)
    bpy.app.handlers.save_pre.append(saving)


def unregister() -> None:
    bpy.app.handlers.load_post.remove(loaded)
    bpy.app.handlers.save_pre.remove(saving)


def mark(sampled: list[Sampled], earlier: "Sources") -> None:
    """Gives each object an identifier of its own: of copies, the one that an earlier preset was made of keeps it."""
    used: set[str] = set()
    known = {entry.get("session_uid") for entry in earlier.objects.values()} if earlier.is_of_session else set()
    for each in sorted(sampled, key=lambda each: each.source.session_uid not in known):
        role = each.source.meniscus
        if not role.identifier or role.identifier in used:
            role.identifier = uuid.uuid4().hex
        used.add(role.identifier)


def entries(sampled: list[Sampled]) -> dict[str, dict[str, object]]:
    """What `objects.json` has of each object, by the name of its asset."""
    return {
        each.asset: {
            "object": each.source.name,
            "role": each.source.meniscus.role,
            "identifier": each.source.meniscus.identifier,
            "session_uid": each.source.session_uid,
            "start": each.matrices[0].ravel().tolist(),
        }
        for each in sampled
    }


class Sources:
    """The objects that the preset of a folder was made of, by the names of their files and outputs."""

    def __init__(self, root: Path) -> None:
        data = assets.read_objects(root)
        objects = data.get("objects")
        self.is_of_session = data.get("session") == session
        objects = objects if isinstance(objects, dict) else {}
        self.objects: dict[str, dict] = {asset: entry for asset, entry in objects.items() if isinstance(entry, dict)}

    def object(self, scene: bpy.types.Scene, asset: str, role: str) -> bpy.types.Object | None:
        """The object of an asset, unless it is gone, has another role now, or the list is broken."""
        entry = self.objects.get(asset)
        found = self.find(scene, entry) if entry is not None else None
        return found if found is not None and found.meniscus.role == role and self.start(asset) is not None else None

    def find(self, scene: bpy.types.Scene, entry: dict) -> bpy.types.Object | None:
        number, identifier, name = entry.get("session_uid"), entry.get("identifier"), entry.get("object")
        if self.is_of_session:
            exact = next((each for each in scene.objects if each.session_uid == number), None)
            if exact is not None:
                return exact
            if not any(each.session_uid == number and each.users_scene for each in bpy.data.objects):
                # It is gone, and a copy that has its identifier is another object. Undo brings it back with its number.
                return None
            # It is in another scene, of which this one is a copy.
        every = self.marked(scene, entry)
        marked = every if self.is_of_session else self.originals(every, entry)
        named = scene.objects.get(name) if isinstance(name, str) else None
        if named in every and named not in marked:
            # A copy that has taken the name.
            named = None
        if named in marked or not marked:
            # An object that has taken the name of another is not the other.
            others = {one.get("identifier") for one in self.objects.values()} - {identifier}
            return named if named is not None and named.meniscus.identifier not in others - {""} else None
        return marked[0] if len(marked) == 1 else None

    def marked(self, scene: bpy.types.Scene, entry: dict) -> list[bpy.types.Object]:
        """The objects with the identifier of an entry: the original, and copies of it."""
        identifier = entry.get("identifier")
        return [each for each in scene.objects if identifier and each.meniscus.identifier == identifier]

    def originals(self, marked: list[bpy.types.Object], entry: dict) -> list[bpy.types.Object]:
        """Of the objects with one identifier the one that it was given to; several if they cannot be distinguished."""
        if self.is_of_session:
            return [each for each in marked if each.session_uid == entry.get("session_uid")]
        # The identifier was in the file: what was made after it was loaded is a copy.
        loaded = [each for each in marked if not newest or each.session_uid <= newest]
        named = [each for each in loaded if each.name == entry.get("object")]
        return named[:1] or loaded

    def lacking(self, scene: bpy.types.Scene, outputs: list[str], role: str) -> list[str]:
        """Messages on outputs of objects with a role that are not in the scene any more, or have another role."""
        shown = "the result has the engine's mesh, without materials and UV map" if role == "CLOTH" else "the result is not shown"
        notes = []
        for output in outputs:
            entry = self.objects.get(output)
            if entry is not None and entry.get("role") == role and self.object(scene, output, role) is None:
                name = printable(entry.get("object"))
                notes.append(f"{printable(output)}: its object {name} is not found, or has another role now; {shown}. Simulate again for what the scene has")
        return notes

    def start(self, asset: str) -> Matrix | None:
        """The world matrix in the first frame, with lengths in metres."""
        values = self.objects[asset].get("start")
        is_sound = isinstance(values, list) and len(values) == 16 and all(type(one) in (int, float) and abs(one) < 1e9 for one in values)
        return Matrix([values[4 * row : 4 * row + 4] for row in range(4)]) if is_sound else None

    def relabel(self, scene: bpy.types.Scene, output: str, keys: dict[str, str]) -> None:
        """Gives results of renamed objects the key under which their object is shown now; `keys` has it by asset, `output` is its property."""
        shown = {self.objects[asset].get("identifier"): key for asset, key in keys.items() if asset in self.objects}
        for each in scene.objects:
            key = shown.get(each.get(SOURCE)) if each.get(SOURCE) else None
            if key is not None and each.get(output, "").partition(":")[0] == key.partition(":")[0]:
                each[output] = key
