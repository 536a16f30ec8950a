//! Meshes of cells, where the simulation has them: positions of points, and the points of each cell.

use crate::cells::Shape;
use crate::conduit::{NodeArray, hashed};
use crate::strided_grid::StridedGrid;
use glam::DVec3;
use std::iter::Sum;
use std::ops::{Div, Range};

/// A mesh of cells over points.
#[derive(Debug)]
pub(crate) struct CellMesh {
    pub(crate) points: Points,
    pub(crate) cells: Cells,
}

/// Positions of points.
#[derive(Debug)]
pub(crate) enum Points {
    /// x, y and z of each.
    Listed([NodeArray; 3]),
    /// Of a rectilinear grid: along each axis.
    Axes([Vec<f64>; 3]),
}

/// The points of each cell.
#[derive(Debug)]
pub(crate) enum Cells {
    /// Hexahedra between the points of a grid, which may lie amid ghosts.
    Grid(StridedGrid),
    Listed(Box<ListedCells>),
}

/// Cells as lists of their points; a polyhedron as a list of faces.
#[derive(Debug)]
pub(crate) struct ListedCells {
    pub(crate) shapes: Shapes,
    pub(crate) lists: Lists,
    /// Points of faces; empty where no cell is a polyhedron.
    pub(crate) faces: Option<Lists>,
}

/// Lists one after the other.
#[derive(Debug)]
pub(crate) struct Lists {
    pub(crate) all: NodeArray,
    pub(crate) ranges: Ranges,
}

/// Where each list lies.
#[derive(Debug)]
pub(crate) enum Ranges {
    /// All of one length.
    Every(usize),
    /// Of stated lengths, one after the other: where each begins, and where the last ends.
    Following(Vec<usize>),
    Stated {
        offsets: NodeArray,
        sizes: NodeArray,
    },
    /// All of one length, each at its place.
    At {
        offsets: NodeArray,
        size: usize,
    },
}

/// The shape of each cell; no shape is a polyhedron.
#[derive(Debug)]
pub(crate) enum Shapes {
    All(Option<Shape>),
    /// By number, and what the numbers stand for.
    Numbered(NodeArray, Vec<(f64, Option<Shape>)>),
}

impl Lists {
    fn range(&self, n: usize) -> Option<Range<usize>> {
        let range = match &self.ranges {
            Ranges::Every(size) => n * size..(n + 1) * size,
            Ranges::Following(starts) => *starts.get(n)?..*starts.get(n + 1)?,
            Ranges::At { offsets, size } => {
                let start = index(offsets.get(n)?)?;
                start..start.checked_add(*size)?
            }
            Ranges::Stated { offsets, sizes } => {
                let start = index(offsets.get(n)?)?;
                start..start.checked_add(index(sizes.get(n)?)?)?
            }
        };
        (range.end <= self.all.len).then_some(range)
    }

    /// List `n`.
    fn list(&self, n: usize) -> Option<impl Iterator<Item = Option<usize>> + '_> {
        Some(self.range(n)?.map(|place| self.all.get(place).and_then(index)))
    }

    /// How many lists there are.
    fn len(&self) -> usize {
        match &self.ranges {
            Ranges::Every(size) => self.all.len / size.max(&1),
            Ranges::Following(starts) => starts.len().saturating_sub(1),
            Ranges::Stated { offsets, sizes } => offsets.len.min(sizes.len),
            Ranges::At { offsets, .. } => offsets.len,
        }
    }

    fn fingerprint(&self, sum: u64) -> u64 {
        let sum = self.all.fingerprint(sum);
        match &self.ranges {
            Ranges::Every(size) => hashed(sum, *size as u64),
            Ranges::Following(starts) => starts.iter().fold(sum, |sum, start| hashed(sum, *start as u64)),
            Ranges::Stated { offsets, sizes } => sizes.fingerprint(offsets.fingerprint(sum)),
            Ranges::At { offsets, size } => hashed(offsets.fingerprint(sum), *size as u64),
        }
    }
}

/// A number of a point, face or place.
fn index(value: f64) -> Option<usize> {
    (value >= 0.0 && value < 2f64.powi(53)).then_some(value as usize)
}

/// One cell: the points of its shape, or the loops of a polyhedron's faces one after the other.
#[derive(Debug, Default)]
pub(crate) struct CellPoints {
    pub(crate) points: Vec<usize>,
    pub(crate) positions: Vec<DVec3>,
    pub(crate) shape: Option<Shape>,
    /// How many of the points each face has.
    faces: Vec<usize>,
}

impl Points {
    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Listed(axes) => axes.iter().map(|axis| axis.len).min().unwrap_or(0),
            Self::Axes(axes) => axes.iter().map(Vec::len).product(),
        }
    }

    /// Where point `n` lies.
    fn position(&self, n: usize) -> Option<DVec3> {
        Some(match self {
            Self::Listed([x, y, z]) => DVec3::new(x.get(n)?, y.get(n)?, z.get(n)?),
            Self::Axes([x, y, z]) => {
                let (i, rest) = (n % x.len(), n / x.len());
                DVec3::new(x[i], y[rest % y.len()], *z.get(rest / y.len())?)
            }
        })
    }

    /// The least box that holds all.
    pub(crate) fn bounds(&self) -> Option<[DVec3; 2]> {
        bounds((0..self.len()).filter_map(|n| self.position(n)))
    }
}

/// The least box that holds all positions; none, where there is no finite one.
fn bounds(positions: impl Iterator<Item = DVec3>) -> Option<[DVec3; 2]> {
    let both = |p| [p, p];
    positions.filter(|p| p.is_finite()).map(both).reduce(|[low, high], [p, _]| [low.min(p), high.max(p)])
}

impl CellMesh {
    /// How many cells there are.
    pub(crate) fn cells(&self) -> usize {
        match &self.cells {
            Cells::Grid(grid) => grid.dims.iter().map(|points| points.saturating_sub(1)).product(),
            Cells::Listed(listed) => match &listed.shapes {
                Shapes::All(_) => listed.lists.len(),
                Shapes::Numbered(numbers, _) => numbers.len.min(listed.lists.len()),
            },
        }
    }

    /// Reads the points of cell `n` into `cell`; nothing, if there is no such cell, or it is of no shape that is shown.
    pub(crate) fn read(&self, n: usize, cell: &mut CellPoints) -> Option<()> {
        cell.points.clear();
        cell.faces.clear();
        match &self.cells {
            Cells::Grid(StridedGrid { dims: [x, y, _], .. }) => {
                let (i, rest) = (n % (x - 1), n / (x - 1));
                let (j, k) = (rest % (y - 1), rest / (y - 1));
                let first = i + x * (j + y * k);
                let layer = [first, first + 1, first + 1 + x, first + x];
                cell.points.extend(layer.into_iter().chain(layer.map(|point| point + x * y)));
                cell.shape = Some(Shape::Hexahedron);
            }
            Cells::Listed(listed) => {
                cell.shape = match &listed.shapes {
                    Shapes::All(shape) => *shape,
                    Shapes::Numbered(numbers, known) => {
                        let number = numbers.get(n)?;
                        known.iter().find(|(known, _)| *known == number)?.1
                    }
                };
                for part in listed.lists.list(n)? {
                    match (cell.shape, &listed.faces) {
                        (Some(_), _) => cell.points.push(part?),
                        (None, Some(faces)) => {
                            let before = cell.points.len();
                            for point in faces.list(part?)? {
                                cell.points.push(point?);
                            }
                            cell.faces.push(cell.points.len() - before);
                        }
                        (None, None) => return None,
                    }
                }
                if cell.shape.is_some_and(|shape| shape.vertices() != cell.points.len()) {
                    return None;
                }
            }
        }
        Some(())
    }

    /// Reads the positions of a cell's points.
    pub(crate) fn place(&self, cell: &mut CellPoints) -> Option<()> {
        cell.positions.clear();
        for point in &cell.points {
            let place = match &self.cells {
                Cells::Grid(grid) => grid.of(*point),
                Cells::Listed(_) => *point,
            };
            cell.positions.push(self.points.position(place)?);
        }
        Some(())
    }

    /// A number that is another one where a position or a cell has changed.
    pub(crate) fn fingerprint(&self) -> u64 {
        let sum = match &self.points {
            Points::Listed(axes) => axes.iter().fold(0, |sum, axis| axis.fingerprint(sum)),
            Points::Axes(axes) => axes.iter().flatten().fold(0, |sum, at| hashed(sum, at.to_bits())),
        };
        match &self.cells {
            Cells::Grid(StridedGrid { dims, first, strides }) => {
                let numbers = dims.iter().chain([first]).chain(strides);
                numbers.fold(sum, |sum, number| hashed(sum, *number as u64))
            }
            Cells::Listed(listed) => {
                let sum = std::iter::once(&listed.lists).chain(&listed.faces).fold(sum, |sum, l| l.fingerprint(sum));
                match &listed.shapes {
                    Shapes::All(shape) => hashed(sum, shape.map_or(0, |shape| shape.vertices() as u64)),
                    Shapes::Numbered(numbers, _) => numbers.fingerprint(sum),
                }
            }
        }
    }
}

impl CellPoints {
    /// The least box that holds it.
    pub(crate) fn bounds(&self) -> Option<[DVec3; 2]> {
        bounds(self.positions.iter().copied())
    }

    /// Where `position` lies in it: the part (a tetrahedron of a polyhedron; else 0), and local coordinates there.
    pub(crate) fn locate(&self, position: DVec3) -> Option<(u32, DVec3)> {
        if let Some(shape) = self.shape {
            return Some((0, shape.locate(&self.positions, position)?));
        }
        let parts = 0..self.points.len() as u32;
        parts.into_iter().find_map(|part| {
            let corners = self.tetrahedron(part, |n| self.positions[n]);
            Some((part, Shape::Tetrahedron.locate(&corners, position)?))
        })
    }

    /// The value at local coordinates `at` of a part, from the values `of_point`.
    pub(crate) fn interpolate(&self, part: u32, at: DVec3, of_point: impl Fn(usize) -> f64) -> f64 {
        let value = |n: usize| of_point(self.points[n]);
        let weights = self.shape.unwrap_or(Shape::Tetrahedron).weights(at).into_iter();
        match self.shape {
            Some(shape) => (0..shape.vertices()).map(value).zip(weights).map(|(v, w)| v * w).sum(),
            None => self.tetrahedron(part, value).iter().zip(weights).map(|(v, w)| v * w).sum(),
        }
    }

    /// A polyhedron is split along its edges: the middle of the cell, that of a face, and the two ends of the face's edge that begins
    /// with point `part`.
    fn tetrahedron<T>(&self, part: u32, of: impl Fn(usize) -> T) -> [T; 4]
    where
        T: Sum<T> + Div<f64, Output = T>,
    {
        let (mut first, part) = (0, part as usize);
        let mut size = 0;
        for &points in &self.faces {
            size = points;
            if part < first + points {
                break;
            }
            first += points;
        }
        let next = if part + 1 < first + size { part + 1 } else { first };
        let middle = |range: Range<usize>| {
            let count = range.len() as f64;
            range.map(&of).sum::<T>() / count
        };
        [middle(0..self.points.len()), middle(first..first + size), of(part), of(next)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The unit cube as a polyhedron of six faces.
    fn cube(points: &[f64], faces: &[f64], sizes: &[f64], cell: &[f64]) -> CellMesh {
        let axis = |n: usize| NodeArray::of_slice(&points[n * 8..][..8]);
        CellMesh {
            points: Points::Listed([axis(0), axis(1), axis(2)]),
            cells: Cells::Listed(Box::new(ListedCells {
                shapes: Shapes::All(None),
                lists: Lists { all: NodeArray::of_slice(cell), ranges: Ranges::Every(6) },
                faces: Some(Lists {
                    all: NodeArray::of_slice(faces),
                    ranges: Ranges::Following(
                        std::iter::once(0)
                            .chain(sizes.iter().scan(0, |sum, size| {
                                *sum += *size as usize;
                                Some(*sum)
                            }))
                            .collect(),
                    ),
                }),
            })),
        }
    }

    const CORNERS: [f64; 24] = [
        0., 1., 1., 0., 0., 1., 1., 0., //
        0., 0., 1., 1., 0., 0., 1., 1., //
        0., 0., 0., 0., 1., 1., 1., 1.,
    ];
    const FACES: [f64; 24] =
        [0., 3., 2., 1., 4., 5., 6., 7., 0., 1., 5., 4., 1., 2., 6., 5., 2., 3., 7., 6., 3., 0., 4., 7.];

    #[test]
    fn a_polyhedron_interpolates_a_linear_field_exactly() {
        let mesh = cube(&CORNERS, &FACES, &[4.0; 6], &[0., 1., 2., 3., 4., 5.]);
        let mut cell = CellPoints::default();
        mesh.read(0, &mut cell).and_then(|()| mesh.place(&mut cell)).unwrap();
        let linear = |p: DVec3| 2.0 * p.x - 3.0 * p.y + 0.5 * p.z + 1.0;
        for position in [DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.9, 0.5, 0.4), DVec3::new(0.5, 0.5, 0.5)] {
            let (part, at) = cell.locate(position).unwrap();
            let value = cell.interpolate(part, at, |point| {
                linear(DVec3::new(CORNERS[point], CORNERS[8 + point], CORNERS[16 + point]))
            });
            assert!((value - linear(position)).abs() < 1e-9, "{value} at {position}");
        }
        assert!(cell.locate(DVec3::new(1.1, 0.5, 0.5)).is_none());
    }

    #[test]
    fn cells_that_name_points_or_faces_that_are_not_there_are_none() {
        for (faces, cell) in [(8.0, 5.0), (0.0, 6.0), (-1.0, 5.0), (f64::NAN, 5.0), (0.0, 1e300)] {
            let mut broken = FACES;
            broken[3] = if faces == 0.0 { 1.0 } else { faces };
            let named = [0., 1., 2., 3., 4., cell];
            let mesh = cube(&CORNERS, &broken, &[4.0; 6], &named);
            let mut read = CellPoints::default();
            let is_read = mesh.read(0, &mut read).and_then(|()| mesh.place(&mut read)).is_some();
            assert!(!is_read, "face point {faces}, face {cell}");
        }
    }

    #[test]
    fn a_rectilinear_grid_has_the_hexahedra_between_its_points() {
        let axes = [vec![0.0, 1.0, 4.0], vec![0.0, 2.0], vec![-1.0, 0.0, 3.0]];
        let mesh = CellMesh { points: Points::Axes(axes), cells: Cells::Grid(StridedGrid::dense([3, 2, 3])) };
        assert_eq!((mesh.cells(), mesh.points.len()), (4, 18));
        assert_eq!(mesh.points.bounds(), Some([DVec3::new(0.0, 0.0, -1.0), DVec3::new(4.0, 2.0, 3.0)]));
        let mut cell = CellPoints::default();
        mesh.read(3, &mut cell).and_then(|()| mesh.place(&mut cell)).unwrap();
        assert_eq!(cell.points, [7, 8, 11, 10, 13, 14, 17, 16]);
        let (_, at) = cell.locate(DVec3::new(2.5, 1.0, 0.75)).unwrap();
        assert!((at - DVec3::new(0.5, 0.5, 0.25)).abs().max_element() < 1e-9);
    }
}
