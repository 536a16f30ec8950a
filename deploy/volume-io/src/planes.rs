//! Some planes of a volume whose file is larger than memory, of files that can be read from the middle.

use crate::ReadError;
use crate::series::Series;
use crate::source::SeriesSource;
use lamina_model::{Grid, Volume};
use std::ops::Range;

impl Series {
    /// The grid of step `index`, whose planes can be read apart by [`Self::read_planes`].
    ///
    /// # Errors
    /// If there is no such step, or its file has to be read from its beginning: it is packed, text, or VTK's.
    pub fn grid_of_planes(&self, index: usize) -> Result<Grid, ReadError> {
        let whole = |what: &str| {
            let remedy = "write it as raw values or in chunks (HDF5, Zarr), or leave out --memory";
            Err(ReadError::unsupported(&self.path, format!("planes of {what}"), remedy))
        };
        let Some(field) = self.shown.plain() else { return whole("an expression") };
        match &self.step(index)?.source {
            SeriesSource::Vti(_) => whole("VTK image data"),
            SeriesSource::Nrrd(nrrd) if nrrd.is_packed() => whole("a packed or text NRRD"),
            SeriesSource::Raw(raw) if raw.is_packed() => whole("a gzipped file"),
            SeriesSource::Nrrd(nrrd) => Ok(*nrrd.grid()),
            SeriesSource::Raw(raw) => Ok(*raw.grid()),
            SeriesSource::Arrays(arrays) => arrays.file()?.grid(&self.names[field]),
        }
    }

    /// Planes `planes` of step `index`, all along z, as a volume of their own.
    ///
    /// # Errors
    /// As [`Self::grid_of_planes`], or if the file cannot be read.
    ///
    /// # Panics
    /// If there are no such planes.
    pub fn read_planes(&self, index: usize, planes: Range<usize>) -> Result<Volume, ReadError> {
        let grid = self.grid_of_planes(index)?;
        let [nx, ny, nz] = grid.dims();
        assert!(planes.start < planes.end && planes.end <= nz, "planes {planes:?} of {nz}");
        let points = planes.start * nx * ny..planes.end * nx * ny;
        let voxels = match &self.step(index)?.source {
            SeriesSource::Nrrd(nrrd) => nrrd.read_points(points)?,
            SeriesSource::Raw(raw) => raw.read_points(points)?,
            SeriesSource::Arrays(arrays) => {
                let volume = arrays.file()?.read(arrays.step, &self.names[self.shown.plain().unwrap_or(0)], planes)?;
                return self.marked(volume);
            }
            SeriesSource::Vti(_) => unreachable!("refused above"),
        };
        let mut origin = grid.origin();
        origin.z += planes.start as f64 * grid.spacing().z;
        let slab = Grid::new([nx, ny, planes.len()], grid.spacing(), origin);
        let volume = slab.and_then(|slab| Volume::new(slab, voxels)).map_err(|e| ReadError::grid(&self.path, e))?;
        self.marked(volume)
    }
}
