"""ParaView's reader of recorded steps: load this file in Tools > Manage Plugins, or by `LoadPlugin`.

A step opens with all those of its run that have its representation and resolution, as a series in the simulation's time. A reduced volume
is image data in the data's units; a VDI is a line for each of its supersegments, with `rgba`, `opacity` and the number of its `ray`.
"""

import csv
import json
import sys
from pathlib import Path

from vtkmodules.numpy_interface import dataset_adapter
from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkImageData, vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

try:
    from paraview.util.vtkAlgorithm import smdomain, smhint, smproperty, smproxy
except ImportError:  # Under plain VTK it is an algorithm like others.
    smproxy = None


def _package():
    """The package that this file is in. Behind ParaView's own folders, whose NumPy fits ParaView."""
    if str(Path(__file__).resolve().parents[1]) not in sys.path:
        sys.path.append(str(Path(__file__).resolve().parents[1]))
    import lamina

    return lamina


def _is_vdi(path):
    """By its first bytes: else it is a reduced volume."""
    with open(path, "rb") as file:
        return file.read(4) == b"LVDI"


def series(path):
    """The time and the file of each step that was recorded beside `path` and is like it: at 0 itself alone, where no table names it."""
    path = Path(path)
    table = path.with_name("steps.csv")
    rows = list(csv.DictReader(table.read_text().splitlines())) if table.exists() else []
    file = lambda row: path.with_name(f"step_{int(row['step']):06}.vdi")
    like = lambda row: (row["representation"], row["resolution"])
    mine = {like(row) for row in rows if file(row) == path}
    return sorted({(float(row["time"]), file(row)) for row in rows if like(row) in mine and file(row).exists()}) or [(0.0, path)]


def image_data(step, output):
    """A reduced volume as image data, its values at the points, under the field's name."""
    name, run = "scalar", step.path.with_name("run.json")
    if run.exists():
        name = json.loads(run.read_text())["field"]
    array = step.array
    output.SetDimensions(array.shape)
    output.SetSpacing(step.spacing)
    output.SetOrigin(step.origin)
    dataset_adapter.WrapDataObject(output).PointData.append(array.ravel(order="F"), name)
    output.GetPointData().SetActiveScalars(name)


def lines(step, output):
    """A VDI as a line for each supersegment."""
    import numpy
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    ends, colors = step.ends, step.colors
    points, cells = vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(ends.reshape(-1, 3), deep=True))
    count = len(ends)
    cells.SetData(numpy_to_vtkIdTypeArray(numpy.arange(0, 2 * count + 1, 2), deep=True), numpy_to_vtkIdTypeArray(numpy.arange(2 * count), deep=True))
    output.SetPoints(points)
    output.SetLines(cells)
    of_lines = dataset_adapter.WrapDataObject(output).CellData
    of_lines.append(numpy.rint(255 * colors.clip(0, 1)).astype(numpy.uint8), "rgba")
    of_lines.append(colors[:, 3].copy(), "opacity")
    per_ray = numpy.diff(step.offsets.astype(numpy.int64))
    of_lines.append(numpy.repeat(numpy.arange(len(per_ray), dtype=numpy.int64), per_ray), "ray")


class Reader(VTKPythonAlgorithmBase):
    """The source: FileName is a recorded step."""

    def __init__(self):
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkDataSet")
        self._path, self._steps, self._opened = None, [], None

    def SetFileName(self, path):
        if path and path != "None" and path != self._path:
            self._path = path
            self.Modified()

    def GetTimestepValues(self):
        return [time for time, _ in self._steps]

    def RequestDataObject(self, request, inputs, output):
        wanted = vtkPolyData if _is_vdi(self._path) else vtkImageData
        if not isinstance(vtkDataObject.GetData(output, 0), wanted):
            output.GetInformationObject(0).Set(vtkDataObject.DATA_OBJECT(), wanted())
        return 1

    def RequestInformation(self, request, inputs, output):
        self._steps = series(self._path)
        information, times = output.GetInformationObject(0), self.GetTimestepValues()
        information.Remove(Pipeline.TIME_STEPS())
        for time in times:
            information.Append(Pipeline.TIME_STEPS(), time)
        information.Set(Pipeline.TIME_RANGE(), [times[0], times[-1]], 2)
        if not _is_vdi(self._path):
            # Steps of one resolution have one grid.
            dims = self._read(Path(self._path)).units.shape
            information.Set(Pipeline.WHOLE_EXTENT(), [0, dims[0] - 1, 0, dims[1] - 1, 0, dims[2] - 1], 6)
        return 1

    def RequestData(self, request, inputs, output):
        made, (time, file) = vtkDataObject.GetData(output, 0), self._nearest(output)
        (lines if isinstance(made, vtkPolyData) else image_data)(self._read(file), made)
        made.GetInformation().Set(vtkDataObject.DATA_TIME_STEP(), time)
        return 1

    def _nearest(self, output):
        """The step at the time that is asked for: the last that is not after it."""
        information = output.GetInformationObject(0)
        if not information.Has(Pipeline.UPDATE_TIME_STEP()):
            return next(step for step in self._steps if step[1] == Path(self._path))
        wanted = information.Get(Pipeline.UPDATE_TIME_STEP())
        return max((step for step in self._steps if step[0] <= wanted), default=self._steps[0])

    def _read(self, file):
        """The step in a file; the last one is kept."""
        if self._opened is None or self._opened.path != file:
            self._opened = _package().read(file)
        return self._opened


if smproxy:
    Reader.SetFileName = smproperty.stringvector(name="FileName")(smdomain.filelist()(smhint.filechooser(extensions="vdi lvol", file_description="Lamina steps")(Reader.SetFileName)))
    Reader.GetTimestepValues = smproperty.doublevector(name="TimestepValues", information_only="1", si_class="vtkSITimeStepsProperty")(Reader.GetTimestepValues)
    Reader = smproxy.reader(name="LaminaReader", label="Lamina Reader", extensions="vdi lvol", file_description="Lamina steps")(Reader)
