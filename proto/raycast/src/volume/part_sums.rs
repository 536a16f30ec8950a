//! What the parts of a field give to a coarser grid, to be added up.

use lamina_model::Invalid;

/// What one part of a field gives to a box of a coarser grid's points, such as the reduced volume's.
#[derive(Debug, Clone, PartialEq)]
pub struct PartSums {
    /// First point of the box.
    pub start: [usize; 3],
    /// Points per axis.
    pub dims: [usize; 3],
    /// Weighted sums, of positions in the range for a reduced volume, x fastest.
    pub sums: Vec<f32>,
    /// The share of each point's surroundings that is there; empty where no voxel of the whole field is missing.
    pub shares: Vec<f32>,
}

impl PartSums {
    /// Adds these sums, and the shares if there are any, to those of the whole coarser grid of `dims`.
    ///
    /// # Errors
    /// If the box does not lie in that grid, or has another number of values.
    pub(super) fn add_to(&self, dims: [usize; 3], sums: &mut [f32], shares: &mut Vec<f32>) -> Result<(), Invalid> {
        let count = self.dims.iter().try_fold(1_usize, |n, d| n.checked_mul(*d));
        let lies_in = (0..3).all(|a| self.start[a].checked_add(self.dims[a]).is_some_and(|end| end <= dims[a]));
        if !lies_in || count != Some(self.sums.len()) || ![0, self.sums.len()].contains(&self.shares.len()) {
            return Err(Invalid::new("group", "sums of other points arrived"));
        }
        if !self.shares.is_empty() && shares.is_empty() {
            *shares = vec![0.0; sums.len()];
        }
        let [nx, ny, nz] = self.dims;
        for (row, (y, z)) in (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z))).enumerate() {
            let at = ((self.start[2] + z) * dims[1] + self.start[1] + y) * dims[0] + self.start[0];
            let add = |to: &mut [f32], from: &[f32]| to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
            add(&mut sums[at..at + nx], &self.sums[row * nx..(row + 1) * nx]);
            if !self.shares.is_empty() {
                add(&mut shares[at..at + nx], &self.shares[row * nx..(row + 1) * nx]);
            }
        }
        Ok(())
    }
}
