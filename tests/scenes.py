"""Scenes that tests share: working out what a mesh hides takes seconds. Tests that change a scene make their own."""

import hashlib
import pickle
from collections import OrderedDict

import numpy as np

import fastibl

_KEPT: OrderedDict[str, fastibl.Scene] = OrderedDict()
_MOST = 24


def scene_of(mesh, *arguments, **options):
    """fastibl.Scene(mesh, *arguments, **options): the same one for equal values, among the last that were asked for.

    It is as new: a Session leaves nothing in the scene it is given but the shadow that it baked.
    """
    key = hashlib.sha256(pickle.dumps((arguments, sorted(options.items()))))
    for values in (mesh.vertices, mesh.triangles, mesh.normals, mesh.uvs, mesh.colors):
        key.update(b"none" if values is None else np.ascontiguousarray(values).tobytes() + str(values.shape).encode())
    name = key.hexdigest()
    if name not in _KEPT:
        _KEPT[name] = fastibl.Scene(mesh, *arguments, **options)
    _KEPT.move_to_end(name)
    while len(_KEPT) > _MOST:
        _KEPT.popitem(last=False)
    _KEPT[name].baked_shadow = None
    return _KEPT[name]
