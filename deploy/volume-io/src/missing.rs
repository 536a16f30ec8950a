//! Missing voxels: values that a file uses where it has none become NaN; packed values become the numbers that they stand for.

use lamina_model::{Invalid, Volume, Voxels};

/// What a stored value stands for: `factor * value + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Packing {
    factor: f64,
    offset: f64,
}

impl Packing {
    /// None, if neither is stated or values stand for themselves.
    pub(crate) fn new(factor: Option<f64>, offset: Option<f64>) -> Option<Self> {
        let packing = Self { factor: factor.unwrap_or(1.0), offset: offset.unwrap_or(0.0) };
        (packing != Self { factor: 1.0, offset: 0.0 }).then_some(packing)
    }
}

/// `volume` with NaN where it holds one of `values`, and unpacked. Integers become single precision, unless nothing changes.
pub(crate) fn mark_missing(volume: Volume, values: &[f64], packing: Option<Packing>) -> Result<Volume, Invalid> {
    let (grid, voxels, second) = volume.into_parts();
    let unpacked = |x: f64| packing.map_or(x, |packing| packing.factor * x + packing.offset);
    let voxels = match voxels {
        Voxels::F64(v) => {
            let number = |x: f64| if values.contains(&x) { f64::NAN } else { unpacked(x) };
            Voxels::F64(v.into_iter().map(number).collect())
        }
        // Every other type fits into single precision.
        other => {
            let values: Vec<f32> = values.iter().map(|&value| value as f32).collect();
            let is_missing = |n: usize| values.contains(&(other.get(n) as f32));
            if packing.is_none() && !(0..other.len()).any(is_missing) {
                other
            } else {
                let number = |n| if is_missing(n) { f32::NAN } else { unpacked(other.get(n)) as f32 };
                Voxels::F32((0..other.len()).map(number).collect())
            }
        }
    };
    let volume = Volume::new(grid, voxels)?;
    match second {
        Some((name, second)) => volume.with_color_field(&name, second),
        None => Ok(volume),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use lamina_model::Grid;

    #[test]
    fn missing_values_are_those_as_stored_and_the_others_unpacked() {
        let grid = Grid::new([3, 1, 1], DVec3::ONE, DVec3::ZERO).unwrap();
        let packed = Volume::new(grid, Voxels::I16(vec![-1, 0, 100])).unwrap();
        let packing = Packing::new(Some(0.5), Some(20.0));
        let Voxels::F32(v) = mark_missing(packed.clone(), &[-1.0], packing).unwrap().into_parts().1 else {
            unreachable!()
        };
        assert!(v[0].is_nan() && v[1..] == [20.0, 70.0]);
        assert_eq!(mark_missing(packed.clone(), &[7.0], None).unwrap(), packed, "nothing is missing");
        assert_eq!(Packing::new(Some(1.0), None), None);
    }
}
