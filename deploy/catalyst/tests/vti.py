"""The raw file of simulation.c as image data on its grid: vti.py RAW VTI."""

import pathlib
import sys

data = pathlib.Path(sys.argv[1]).read_bytes()
head = (
    '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
    '<ImageData WholeExtent="0 39 0 35 0 31" Origin="-1 -0.9 -0.8" Spacing="0.05 0.05 0.05"><Piece Extent="0 39 0 35 0 31"><PointData>'
    '<DataArray type="Float32" Name="rho" format="appended" offset="0"/></PointData></Piece></ImageData><AppendedData encoding="raw">_'
)
pathlib.Path(sys.argv[2]).write_bytes(head.encode() + len(data).to_bytes(8, "little") + data + b"</AppendedData></VTKFile>")
