"""What the scripts here share: the scene of peers.toml, its views, and the cubes it shows (raw float32, x fastest)."""
import math, os, tomllib
import numpy as np

SIDE = 255.0  # world units; the cube spans 0..SIDE on every axis, whatever its number of voxels
SIZE = 768    # pixels a side

with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "peers.toml"), "rb") as file:
    SCENE = tomllib.load(file)
POINTS = [(p["at"], *p["color"], p["opacity"]) for p in SCENE["transfer"]["points"]]
UNIT_LENGTH = SCENE["transfer"]["unit_length"]
assert SCENE["transfer"]["range"] == {"lo": 0.0, "hi": 1.0, "scale": "linear"} and not any(SCENE["background"])


def spacing(n):
    """World distance between neighbors of n voxels."""
    return SIDE / (n - 1)


def step_length(n):
    """World distance between samples."""
    return SCENE["step_voxels"] * spacing(n)


def load(path):
    """The cube in a file, as an array [z][y][x]; its side follows from the file's size."""
    values = np.fromfile(path, "<f4")
    n = round(len(values) ** (1 / 3))
    if n ** 3 != len(values) or n < 2:
        raise SystemExit(f"{path}: {len(values)} float32 values are no cube")
    return values.reshape(n, n, n)


def turn_about_y(vector, degrees):
    """A vector turned about +y; 90 degrees take +z to +x."""
    x, y, z = vector
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([c * x + s * z, y, c * z - s * x])


def view(degrees):
    """Eye, target and up of the camera turned about +y through its target."""
    camera = SCENE["camera"]
    target = np.array(camera["target"])
    eye = target + turn_about_y(np.array(camera["position"]) - target, degrees)
    return eye, target, turn_about_y(camera["up"], degrees)
