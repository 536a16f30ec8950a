//! Shapes of cells: where in a cell a position lies, and the weights of its vertices there.
//!
//! A hexahedron is the trilinear image of the unit cube; a wedge and a pyramid are hexahedra whose vertices coincide in part; a tetrahedron
//! is a linear image. The order of vertices and the weights are those of VTK's linear cells, which Blueprint shares.

use glam::{DMat3, DVec3};

/// A cell of few vertices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    Tetrahedron,
    Pyramid,
    Wedge,
    Hexahedron,
}

/// Local coordinates beyond a cell's face by less than this lie on it.
const ON_FACE: f64 = 1e-6;
/// A position is reached where it is off by less than this part of the cell.
const REACHED: f64 = 1e-9;
/// Newton's steps: four are enough for a cell that is not folded; towards the top of a pyramid they are slower.
const STEPS: usize = 40;

impl Shape {
    /// By Blueprint's name.
    pub(crate) fn of_name(name: &str) -> Option<Self> {
        Some(match name {
            "tet" => Self::Tetrahedron,
            "pyramid" => Self::Pyramid,
            "wedge" => Self::Wedge,
            "hex" => Self::Hexahedron,
            _ => return None,
        })
    }

    /// How many vertices it has.
    pub(crate) fn vertices(self) -> usize {
        match self {
            Self::Tetrahedron => 4,
            Self::Pyramid => 5,
            Self::Wedge => 6,
            Self::Hexahedron => 8,
        }
    }

    /// The vertex at each corner of the unit cube, in the order of a hexahedron's vertices.
    fn corners(self) -> [usize; 8] {
        match self {
            Self::Tetrahedron => [0, 1, 2, 2, 3, 3, 3, 3],
            Self::Pyramid => [0, 1, 2, 3, 4, 4, 4, 4],
            Self::Wedge => [0, 1, 2, 2, 3, 4, 5, 5],
            Self::Hexahedron => [0, 1, 2, 3, 4, 5, 6, 7],
        }
    }

    /// Weights of its vertices at local coordinates `at`; those beyond its number are 0.
    pub(crate) fn weights(self, at: DVec3) -> [f64; 8] {
        let mut weights = [0.0; 8];
        if self == Self::Tetrahedron {
            weights[..4].copy_from_slice(&[1.0 - at.element_sum(), at.x, at.y, at.z]);
            return weights;
        }
        for (corner, vertex) in self.corners().into_iter().enumerate() {
            weights[vertex] += factors(corner, at).element_product();
        }
        weights
    }

    /// The local coordinates of `position`, if it lies in the cell of these vertices.
    pub(crate) fn locate(self, vertices: &[DVec3], position: DVec3) -> Option<DVec3> {
        // Seen from its first vertex, in its own size: coordinates may be large, and cells small.
        let first = *vertices.first()?;
        let size = vertices.iter().map(|vertex| (*vertex - first).abs().max_element()).fold(0.0, f64::max);
        let own = |place: DVec3| (place - first) / size;
        let position = own(position);
        if self == Self::Tetrahedron {
            let [_, b, c, d] = vertices.first_chunk()?.map(own);
            let at = DMat3::from_cols(b, c, d).inverse() * position;
            return (at.min_element() >= -ON_FACE && at.element_sum() <= 1.0 + ON_FACE).then_some(at);
        }
        let corners = self.corners().map(|vertex| own(vertices[vertex]));
        let mut at = DVec3::splat(0.5);
        for _ in 0..STEPS {
            let (mut reached, mut slopes) = (DVec3::ZERO, [DVec3::ZERO; 3]);
            for (corner, place) in corners.into_iter().enumerate() {
                let f = factors(corner, at);
                let sign = |axis: usize| if cube(corner)[axis] == 1.0 { 1.0 } else { -1.0 };
                reached += place * f.element_product();
                slopes[0] += place * (sign(0) * f.y * f.z);
                slopes[1] += place * (sign(1) * f.x * f.z);
                slopes[2] += place * (sign(2) * f.x * f.y);
            }
            let off = position - reached;
            if off.abs().max_element() < REACHED {
                let inside = at.min_element() >= -ON_FACE && at.max_element() <= 1.0 + ON_FACE;
                return inside.then_some(at);
            }
            at += DMat3::from_cols(slopes[0], slopes[1], slopes[2]).inverse() * off;
            if !at.is_finite() || (at - 0.5).abs().max_element() > 8.0 {
                return None;
            }
        }
        None
    }
}

/// Where corner `n` of the unit cube lies.
fn cube(n: usize) -> DVec3 {
    let (x, y) = ([0.0, 1.0, 1.0, 0.0][n % 4], [0.0, 0.0, 1.0, 1.0][n % 4]);
    DVec3::new(x, y, if n < 4 { 0.0 } else { 1.0 })
}

/// The factor of each axis in the weight of a corner.
fn factors(corner: usize, at: DVec3) -> DVec3 {
    let c = cube(corner);
    c * at + (1.0 - c) * (1.0 - at)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A skewed cell: the unit cube's corners under a map that bends its faces.
    fn vertices(shape: Shape) -> Vec<DVec3> {
        let bent = |p: DVec3| DVec3::new(p.x + 0.2 * p.y * p.z, p.y - 0.1 * p.x * p.z, 1.5 * p.z + 0.3 * p.x);
        let mut places = vec![DVec3::ZERO; shape.vertices()];
        for (corner, vertex) in shape.corners().into_iter().enumerate() {
            // Where several corners are one vertex, the first stands.
            if places[vertex] == DVec3::ZERO {
                places[vertex] = bent(cube(corner));
            }
        }
        places
    }

    #[test]
    fn a_position_made_of_weights_is_located_where_the_weights_were_taken() {
        for shape in [Shape::Tetrahedron, Shape::Pyramid, Shape::Wedge, Shape::Hexahedron] {
            let places = vertices(shape);
            for at in [DVec3::splat(0.25), DVec3::new(0.1, 0.3, 0.5), DVec3::new(0.6, 0.2, 0.15)] {
                let weights = shape.weights(at);
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{shape:?}");
                let position: DVec3 = places.iter().zip(weights).map(|(place, weight)| *place * weight).sum();
                let found = shape.locate(&places, position).unwrap();
                assert!((found - at).abs().max_element() < 1e-6, "{shape:?}: {found} for {at}");
            }
        }
    }

    #[test]
    fn vertices_and_middles_of_edges_are_in_the_cell_also_far_from_the_origin() {
        for shape in [Shape::Tetrahedron, Shape::Pyramid, Shape::Wedge, Shape::Hexahedron] {
            for (size, origin) in [(1.0, 0.0), (0.01, 1e6), (1.0, 5e6), (1e-7, 1.0)] {
                let places: Vec<DVec3> = vertices(shape).iter().map(|p| *p * size + DVec3::splat(origin)).collect();
                let inner = places.iter().copied().sum::<DVec3>() / places.len() as f64;
                let last = places[places.len() - 1];
                let edge = if shape == Shape::Hexahedron { places[3] } else { places[2] };
                // Not to lie on the wrong side by rounding: a millionth of the way in.
                for position in [places[0], places[2], last, 0.5 * (edge + last)] {
                    let position = position + (inner - position) * 1e-6;
                    let at =
                        shape.locate(&places, position).unwrap_or_else(|| panic!("{shape:?} of {size} at {origin}"));
                    let made: DVec3 = places.iter().zip(shape.weights(at)).map(|(p, w)| *p * w).sum();
                    assert!((made - position).abs().max_element() <= 1e-8 * size + 1e-15 * origin, "{shape:?}: {made}");
                }
            }
            let places = vertices(shape);
            for vertex in &places {
                assert!(shape.locate(&places, *vertex).is_some(), "{shape:?} {vertex}");
            }
        }
    }

    #[test]
    fn positions_outside_are_in_no_cell() {
        for shape in [Shape::Tetrahedron, Shape::Pyramid, Shape::Wedge, Shape::Hexahedron] {
            for outside in [DVec3::splat(-0.2), DVec3::new(0.5, 3.0, 0.5), DVec3::splat(1e30), DVec3::splat(f64::NAN)] {
                assert_eq!(shape.locate(&vertices(shape), outside), None, "{shape:?} {outside}");
            }
        }
    }

    #[test]
    fn a_cell_without_volume_holds_nothing() {
        let flat = vec![DVec3::ZERO; 8];
        for shape in [Shape::Tetrahedron, Shape::Pyramid, Shape::Wedge, Shape::Hexahedron] {
            assert_eq!(shape.locate(&flat, DVec3::ZERO), None, "{shape:?}");
        }
    }
}
