"""Times VTK's ray caster for CPUs (vtkFixedPointVolumeRayCastMapper) on the scene of peers.toml, frame by frame.
Usage: vtk_frame.py FIELD.raw [--frames 5 | --serve] [--threads 2] [--angle 0] [--step VOXELS] [--out PICTURE.npy]

Each frame is one line of JSON: wall_ms and cpu_ms (of this process, all its threads) from the call to the picture in
the window, and cast_ms, the wall time of the rays' casting alone. With --serve a line {"ready": ...} follows the
warm-up frames; then each line read is answered by one line: "frame [DEGREES]" renders, "save PATH.npy" writes the last
picture (8-bit RGB), and "quit" ends."""
import argparse, json, os, resource, sys, time

os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")  # no display is needed
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy
import scene

WARM_UP = 2


class Caster:
    def __init__(self, field, threads, step):
        n = len(field)
        self.scalars = numpy_to_vtk(field.ravel(), deep=1)  # memory shared with numpy costs a third more time
        image = vtk.vtkImageData()
        image.SetDimensions(n, n, n)
        image.SetSpacing(3 * [scene.spacing(n)])
        image.GetPointData().SetScalars(self.scalars)

        color, opacity = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction()
        for at, red, green, blue, alpha in scene.POINTS:
            color.AddRGBPoint(at, red, green, blue)
            opacity.AddPoint(at, alpha)
        look = vtk.vtkVolumeProperty()
        look.SetColor(color)
        look.SetScalarOpacity(opacity)
        look.SetScalarOpacityUnitDistance(scene.UNIT_LENGTH)
        look.SetInterpolationTypeToLinear()
        look.ShadeOff()

        mapper = vtk.vtkFixedPointVolumeRayCastMapper()
        mapper.SetInputData(image)
        mapper.SetNumberOfThreads(threads)
        mapper.SetBlendModeToComposite()
        # One ray a pixel and the stated step, always: none of these may adapt to the time a frame took.
        mapper.AutoAdjustSampleDistancesOff()
        mapper.LockSampleDistanceToInputSpacingOff()
        mapper.SetImageSampleDistance(1.0)
        mapper.SetSampleDistance(step)
        mapper.SetInteractiveSampleDistance(step)
        self.began = self.cast_s = 0.0
        mapper.AddObserver("VolumeMapperRenderStartEvent", self.cast_begins)
        mapper.AddObserver("VolumeMapperRenderEndEvent", self.cast_ends)

        volume = vtk.vtkVolume()
        volume.SetMapper(mapper)
        volume.SetProperty(look)
        self.renderer = vtk.vtkRenderer()
        self.renderer.SetBackground(0, 0, 0)
        self.renderer.AddVolume(volume)
        self.window = vtk.vtkRenderWindow()
        self.window.OffScreenRenderingOn()
        self.window.SetMultiSamples(0)
        self.window.SetSize(scene.SIZE, scene.SIZE)
        self.window.SetDesiredUpdateRate(1e-5)
        self.window.AddRenderer(self.renderer)

    def cast_begins(self, *_):
        self.began = time.perf_counter()

    def cast_ends(self, *_):
        self.cast_s += time.perf_counter() - self.began

    def frame(self, degrees):
        eye, target, up = scene.view(degrees)
        camera = self.renderer.GetActiveCamera()
        camera.SetPosition(*eye)
        camera.SetFocalPoint(*target)
        camera.SetViewUp(*up)
        camera.SetViewAngle(scene.SCENE["camera"]["fov_y_deg"])
        self.renderer.ResetCameraClippingRange()
        self.cast_s = 0.0
        cpu, wall = cpu_seconds(), time.perf_counter()
        self.window.Render()
        wall, cpu = time.perf_counter() - wall, cpu_seconds() - cpu
        return {"wall_ms": round(1e3 * wall, 2), "cpu_ms": round(1e3 * cpu, 2), "cast_ms": round(1e3 * self.cast_s, 2)}

    def picture(self):
        """The last frame, rows from the top, 8-bit RGB."""
        last, pixels = scene.SIZE - 1, vtk.vtkUnsignedCharArray()
        self.window.GetRGBACharPixelData(0, 0, last, last, 1, pixels)
        return vtk_to_numpy(pixels).reshape(scene.SIZE, scene.SIZE, 4)[::-1, :, :3].copy()


def cpu_seconds():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def say(answer):
    print(json.dumps(answer), flush=True)


def serve(caster, angle):
    for line in sys.stdin:
        command, _, rest = line.strip().partition(" ")
        if command == "frame":
            say(caster.frame(float(rest) if rest else angle))
        elif command == "save" and rest:
            np.save(rest, caster.picture())
            say({"saved": rest})
        elif command == "quit":
            return
        else:
            say({"error": f"{line.strip()!r}: say frame [DEGREES], save PATH.npy or quit"})


def main():
    usage = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    usage.add_argument("field")
    usage.add_argument("--frames", type=int, default=5)
    usage.add_argument("--serve", action="store_true")
    usage.add_argument("--threads", type=int, default=2)
    usage.add_argument("--angle", type=float, default=0.0)
    usage.add_argument("--step", type=float, metavar="VOXELS", default=scene.SCENE["step_voxels"])
    usage.add_argument("--out")
    given = usage.parse_args()
    field = scene.load(given.field)
    caster = Caster(field, given.threads, given.step * scene.spacing(len(field)))
    for _ in range(WARM_UP):
        caster.frame(given.angle)
    if given.serve:
        say({"ready": f"vtk {vtk.vtkVersion.GetVTKVersion()}", "threads": given.threads, "voxels": len(field)})
        serve(caster, given.angle)
    else:
        for _ in range(given.frames):
            say(caster.frame(given.angle))
    if given.out:
        np.save(given.out, caster.picture())


if __name__ == "__main__":
    main()
