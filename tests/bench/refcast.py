"""A second ray caster, to check Lamina's pictures against: the scene of peers.toml in float64, in numba.
Usage: refcast.py FIELD.raw OUT_{:02}.npy [--angles 0 10 20] [--size 768]    ({} is the angle; RGB, float32)

Values are interpolated trilinearly and classified exactly. Samples lie in the middle of equal steps from the ray's
entry into the cube, the last of them cut at its exit. No ray ends early."""
import argparse, math
import numba, numpy as np
import scene


@numba.njit
def crossing(eye, ray, side):
    """Where a ray enters and leaves the cube 0..side; the entry is not before the exit if it misses."""
    enter, leave = 0.0, np.inf
    for axis in range(3):
        if ray[axis] == 0.0:
            if not 0.0 <= eye[axis] <= side:
                return 0.0, 0.0
        else:
            one, other = -eye[axis] / ray[axis], (side - eye[axis]) / ray[axis]
            enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return enter, leave


@numba.njit
def value(field, x, y, z):
    """The trilinear value at a position in voxels."""
    most = field.shape[0] - 1
    x, y, z = min(max(x, 0.0), most), min(max(y, 0.0), most), min(max(z, 0.0), most)
    i, j, k = min(int(x), most - 1), min(int(y), most - 1), min(int(z), most - 1)
    x, y, z = x - i, y - j, z - k
    total = 0.0
    for c in range(2):
        for b in range(2):
            for a in range(2):
                weight = (x if a else 1.0 - x) * (y if b else 1.0 - y) * (z if c else 1.0 - z)
                total += weight * field[k + c, j + b, i + a]
    return total


@numba.njit(parallel=True)
def cast(field, points, unit_length, step, side, eye, right, up, forward, tan_half, picture):
    size, per_world = picture.shape[0], (field.shape[0] - 1) / side
    for row in numba.prange(size):
        for column in range(size):
            sx, sy = ((2.0 * column + 1.0) / size - 1.0) * tan_half, (1.0 - (2.0 * row + 1.0) / size) * tan_half
            ray = forward + sx * right + sy * up
            ray /= math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
            start, end = crossing(eye, ray, side)
            red, green, blue, clear = 0.0, 0.0, 0.0, 1.0
            while start < end - 1e-9 * step:
                length = min(step, end - start)
                at = (eye + (start + 0.5 * length) * ray) * per_world
                start += length
                v = value(field, at[0], at[1], at[2])
                p = 1
                while p < len(points) - 1 and points[p, 0] < v:
                    p += 1
                w = min(max((v - points[p - 1, 0]) / (points[p, 0] - points[p - 1, 0]), 0.0), 1.0)
                opacity = points[p - 1, 4] + w * (points[p, 4] - points[p - 1, 4])
                if opacity <= 0.0:
                    continue
                through = (1.0 - opacity) ** (length / unit_length)
                light = clear * (1.0 - through)
                red += light * (points[p - 1, 1] + w * (points[p, 1] - points[p - 1, 1]))
                green += light * (points[p - 1, 2] + w * (points[p, 2] - points[p - 1, 2]))
                blue += light * (points[p - 1, 3] + w * (points[p, 3] - points[p - 1, 3]))
                clear *= through
            picture[row, column, 0], picture[row, column, 1], picture[row, column, 2] = red, green, blue


def render(field, degrees, size=scene.SIZE):
    """The picture of a cube from the camera turned by an angle: size x size x RGB, rows from the top."""
    eye, target, up = scene.view(degrees)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    tan_half = math.tan(math.radians(scene.SCENE["camera"]["fov_y_deg"]) / 2)
    picture = np.zeros((size, size, 3))
    cast(field, np.array(scene.POINTS), scene.UNIT_LENGTH, scene.step_length(len(field)), scene.SIDE,
         eye, right, np.cross(right, forward), forward, tan_half, picture)
    return picture.astype(np.float32)


if __name__ == "__main__":
    usage = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usage.add_argument("field")
    usage.add_argument("out")
    usage.add_argument("--angles", type=float, nargs="+", default=[0, 10, 20, 30, 40, 50, 60])
    usage.add_argument("--size", type=int, default=scene.SIZE)
    given = usage.parse_args()
    cube = scene.load(given.field)
    for angle in given.angles:
        name = given.out.format(int(angle) if angle == int(angle) else angle)
        np.save(name, render(cube, angle, given.size))
        print(name, flush=True)
