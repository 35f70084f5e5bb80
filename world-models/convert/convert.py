#!/usr/bin/env python3
"""Makes the object models that ship, from their sources.

    python3 convert.py --assets DIR [--library DIR] [NAME ...]

DIR holds the sources as published: `franka` (franka_description: robots/fer, end_effectors/franka_hand, meshes), `furniture_sim`
(vikashplus/furniture_sim), `metaworld` (metaworld/assets of the PyPI wheel), `ycb_mug` (utensil_mug_blue of yding25/URDF_models);
each model's `provenance` names the version. A version that exists already is left as it is.
"""

import argparse
import os
import tempfile

import drawer
import microwave
import mug
import panda
import tape
from common import publish

MODELS = {"panda": panda, "microwave": microwave, "drawer": drawer, "mug": mug, "tape": tape}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--assets", required=True)
    parser.add_argument("--library", default=os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
    parser.add_argument("names", nargs="*", help="models to make; all if none is named")
    arguments = parser.parse_args()
    for name in arguments.names or MODELS:
        staged = tempfile.mkdtemp(prefix=".staged-", dir=arguments.library)
        os.chmod(staged, 0o755)
        MODELS[name].convert(arguments.assets, staged)
        print(name, publish(arguments.library, name, staged))
