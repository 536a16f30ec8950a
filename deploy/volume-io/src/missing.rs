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

    pub(crate) fn unpacked(&self, value: f64) -> f64 {
        self.factor * value + self.offset
    }
}

/// What stored numbers mean.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Meaning {
    /// The values that stand where there is none, as they are stored.
    pub(crate) missing: Vec<f64>,
    pub(crate) packing: Option<Packing>,
    /// What is to be added to negative numbers, of integers without a sign that are stored as if they had one.
    pub(crate) unsigned: Option<f64>,
}

impl Meaning {
    fn number(&self, stored: f64) -> f64 {
        let value = self.unsigned.filter(|_| stored < 0.0).map_or(stored, |range| stored + range);
        self.packing.map_or(value, |packing| packing.unpacked(value))
    }
}

/// `volume` with NaN where a value is missing, and the others as what they mean. Integers become single precision, unless nothing changes.
pub(crate) fn mark_missing(volume: Volume, meaning: &Meaning) -> Result<Volume, Invalid> {
    let (grid, voxels, second) = volume.into_parts();
    let values = &meaning.missing;
    let voxels = match voxels {
        Voxels::F64(v) => {
            let number = |x: f64| if values.contains(&x) { f64::NAN } else { meaning.number(x) };
            Voxels::F64(v.into_iter().map(number).collect())
        }
        // Every other type fits into single precision.
        other => {
            let values: Vec<f32> = values.iter().map(|&value| value as f32).collect();
            let is_missing = |n: usize| values.contains(&(other.get(n) as f32));
            let is_plain = meaning.packing.is_none() && meaning.unsigned.is_none();
            if is_plain && !(0..other.len()).any(is_missing) {
                other
            } else {
                let number = |n| if is_missing(n) { f32::NAN } else { meaning.number(other.get(n)) as f32 };
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
        let meaning = |missing: &[f64], packing, unsigned| Meaning { missing: missing.to_vec(), packing, unsigned };
        let singles = |volume: Volume| match volume.into_parts().1 {
            Voxels::F32(values) => values,
            other => unreachable!("{other:?}"),
        };
        let half = meaning(&[-1.0], Packing::new(Some(0.5), Some(20.0)), None);
        let v = singles(mark_missing(packed.clone(), &half).unwrap());
        assert!(v[0].is_nan() && v[1..] == [20.0, 70.0]);
        let unsigned = meaning(&[0.0], None, Some(256.0));
        let v = singles(mark_missing(packed.clone(), &unsigned).unwrap());
        assert!(v[1].is_nan() && (v[0], v[2]) == (255.0, 100.0));
        assert_eq!(mark_missing(packed.clone(), &meaning(&[7.0], None, None)).unwrap(), packed, "nothing is missing");
        assert_eq!(Packing::new(Some(1.0), None), None);
    }
}
