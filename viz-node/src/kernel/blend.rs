//! How much care a picture of a VDI takes: the nearest rays of the VDI, or a blend of those around.
//!
//! A novel ray that takes, at every place, the list of the pixel it is in sees steps as wide as that pixel. The mean of four
//! pictures for which the VDI's image is displaced by parts of a pixel weighs the lists around by how near they are. The
//! displacements are a rotated grid: on both axes all four odd eighths, so that edges along the VDI's rows and columns get four
//! grades from four pictures. None leaves a pixel: seen from the generation camera at the VDI's own resolution nothing
//! changes. Where the volume reaches beyond the VDI's image, half of the image's outermost pixel fades.

/// How carefully a VDI is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// The lists that are nearest: for pictures in motion.
    Nearest,
    /// Those around, blended, for four times the work: for pictures at rest, and what quality is measured of.
    Blended,
}

/// By how much the VDI's image is displaced, in its pixels.
pub type Displacement = [f64; 2];

/// Columns and rows.
const ROTATED_GRID: [Displacement; 4] = [[0.375, 0.125], [-0.375, -0.125], [0.125, -0.375], [-0.125, 0.375]];

/// The colours that `draw` gives, taken with `detail`.
///
/// # Errors
/// Those of `draw`.
pub fn drawn<E>(
    detail: Detail,
    mut draw: impl FnMut(Displacement) -> Result<Vec<[f32; 3]>, E>,
) -> Result<Vec<[f32; 3]>, E> {
    if detail == Detail::Nearest {
        return draw([0.0; 2]);
    }
    // Two pairs: four equal colours have exactly their mean.
    let [first, second, third, fourth] = ROTATED_GRID;
    let mut left = sum(draw(first)?, &draw(second)?);
    let right = sum(draw(third)?, &draw(fourth)?);
    left = sum(left, &right);
    left.as_flattened_mut().iter_mut().for_each(|c| *c *= 0.25);
    Ok(left)
}

fn sum(mut a: Vec<[f32; 3]>, b: &[[f32; 3]]) -> Vec<[f32; 3]> {
    a.as_flattened_mut().iter_mut().zip(b.as_flattened()).for_each(|(a, b)| *a += b);
    a
}
