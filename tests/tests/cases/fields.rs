//! Volumes by the name of their field.

use glam::DVec3;
use half::f16;
use lamina_model::{Grid, Invalid, Volume, VoxelType, Voxels};
use serde::Deserialize;

/// A volume as cases write it.
#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub(crate) struct VolumeFields {
    pub dims: [usize; 3],
    pub spacing: DVec3,
    pub origin: DVec3,
    pub voxel_type: VoxelType,
    pub field: Field,
    /// Voxels of another value, after the field.
    #[serde(default)]
    pub holes: Vec<Hole>,
}

/// A scalar field.
#[derive(Deserialize, Debug, Clone)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Field {
    /// The same everywhere.
    Constant(f64),
    /// From the first value at the first sample point of an axis to the second at the last.
    Ramp { axis: usize, from: f64, to: f64 },
    /// One value in the lower half of an axis, another in the upper.
    Step { axis: usize, below: f64, above: f64 },
    /// Two values in turn, along every axis.
    Checkerboard([f64; 2]),
    /// One voxel.
    Delta { at: [usize; 3], value: f64 },
    /// Anything between two values, the same every time, no voxel like its neighbor.
    Noise([f64; 2]),
    /// From the first value in the middle of the box to the second at its corners.
    Distance([f64; 2]),
}

#[derive(Deserialize, Debug, Clone)]
#[serde(deny_unknown_fields)]
pub(crate) struct Hole {
    at: [usize; 3],
    value: f64,
}

impl VolumeFields {
    pub(crate) fn volume(&self) -> Result<Volume, Invalid> {
        let grid = Grid::new(self.dims, self.spacing, self.origin)?;
        let [nx, ny, _] = self.dims;
        let mut values: Vec<f64> =
            (0..grid.voxels()).map(|n| self.value([n % nx, n / nx % ny, n / (nx * ny)])).collect();
        for Hole { at, value } in &self.holes {
            values[(at[2] * ny + at[1]) * nx + at[0]] = *value;
        }
        Volume::new(grid, voxels(self.voxel_type, values))
    }

    fn value(&self, at: [usize; 3]) -> f64 {
        match self.field {
            Field::Constant(value) => value,
            Field::Ramp { axis, from, to } => from + (to - from) * at[axis] as f64 / (self.dims[axis] - 1) as f64,
            Field::Step { axis, below, above } => {
                if 2 * at[axis] < self.dims[axis] {
                    below
                } else {
                    above
                }
            }
            Field::Checkerboard(values) => values[(at[0] + at[1] + at[2]) % 2],
            Field::Delta { at: one, value } => f64::from(u8::from(at == one)) * value,
            Field::Noise([from, to]) => {
                let n = (at[2] * self.dims[1] + at[1]) * self.dims[0] + at[0];
                // Weyl's sequence of the golden ratio.
                from + (to - from) * (n as f64 * 0.618_033_988_749_894_8).fract()
            }
            Field::Distance([from, to]) => {
                let middle = DVec3::from(self.dims.map(|n| 0.5 * (n - 1) as f64));
                let away = (DVec3::from(at.map(|i| i as f64)) - middle) / middle;
                from + (to - from) * away.length() / 3.0_f64.sqrt()
            }
        }
    }
}

fn voxels(voxel_type: VoxelType, values: Vec<f64>) -> Voxels {
    let values = values.into_iter();
    match voxel_type {
        VoxelType::U8 => Voxels::U8(values.map(|x| x.round() as u8).collect()),
        VoxelType::U16 => Voxels::U16(values.map(|x| x.round() as u16).collect()),
        VoxelType::I16 => Voxels::I16(values.map(|x| x.round() as i16).collect()),
        VoxelType::F16 => Voxels::F16(values.map(f16::from_f64).collect()),
        VoxelType::F32 => Voxels::F32(values.map(|x| x as f32).collect()),
        VoxelType::F64 => Voxels::F64(values.collect()),
    }
}
