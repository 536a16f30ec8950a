//! From the axes of an NRRD header, of which there may be any number, to a grid of three.

use crate::ReadError;
use crate::nrrd_header::Fields;
use glam::DVec3;
use lamina_model::Grid;
use std::path::Path;

/// As many axes as the format allows.
const MOST_AXES: usize = 16;

/// How far a direction may lean off its axis and still count as along it, as a share of its length.
const LEAN: f64 = 1e-6;

struct NrrdAxis {
    size: usize,
    /// Distance of samples; none where the header does not know.
    spacing: Option<f64>,
    direction: Option<Vec<f64>>,
}

/// The grid that the header's axes make up.
pub(crate) fn grid(path: &Path, fields: &Fields) -> Result<Grid, ReadError> {
    let directed = fields.get("spacedirections").is_some();
    let mut axes = spatial(path, axes(path, fields)?, directed)?;
    while axes.len() < 3 {
        axes.push(NrrdAxis { size: 1, spacing: None, direction: None });
    }
    let (mut dims, mut spacing) = ([0; 3], DVec3::ONE);
    for (index, axis) in axes.iter().enumerate() {
        dims[index] = axis.size;
        spacing[index] = match &axis.direction {
            Some(direction) => along(path, index, direction)?,
            None => axis.spacing.unwrap_or(1.0),
        };
    }
    Grid::new(dims, spacing, origin(path, fields)?).map_err(|e| ReadError::grid(path, e))
}

fn axes(path: &Path, fields: &Fields) -> Result<Vec<NrrdAxis>, ReadError> {
    let sizes: Vec<usize> = numbers(path, "sizes", fields.require(path, "sizes")?)?;
    let dimension = fields.number(path, "dimension")?;
    if sizes.is_empty() || sizes.len() > MOST_AXES || dimension != sizes.len() as i64 {
        let reason = format!("\"dimension: {dimension}\" does not go with {} sizes", sizes.len());
        return Err(ReadError::damaged(path, reason));
    }
    let count_of = |field: &str, n: usize| match n == sizes.len() {
        true => Ok(()),
        false => Err(ReadError::damaged(path, format!("\"{field}\" names {n} axes of {}", sizes.len()))),
    };
    let mut axes: Vec<_> = sizes.iter().map(|&size| NrrdAxis { size, spacing: None, direction: None }).collect();
    if let Some(text) = fields.get("spacings") {
        let spacings: Vec<f64> = numbers(path, "spacings", text)?;
        count_of("spacings", spacings.len())?;
        for (axis, spacing) in axes.iter_mut().zip(spacings) {
            axis.spacing = Some(spacing).filter(|s| !s.is_nan());
        }
    }
    if let Some(text) = fields.get("spacedirections") {
        let directions = vectors(path, "space directions", text)?;
        count_of("space directions", directions.len())?;
        for (axis, direction) in axes.iter_mut().zip(directions) {
            axis.direction = direction;
        }
    }
    Ok(axes)
}

/// Drops axes of size 1 until three are left: those without a direction, else the first or the last.
fn spatial(path: &Path, mut axes: Vec<NrrdAxis>, directed: bool) -> Result<Vec<NrrdAxis>, ReadError> {
    while axes.len() > 3 {
        let outer = [0, axes.len() - 1];
        let undirected = |index: &usize| !directed || axes[*index].direction.is_none();
        let single = |index: &usize| axes[*index].size == 1;
        let idle = outer.into_iter().filter(undirected).find(single).or_else(|| outer.into_iter().find(single));
        let Some(index) = idle else {
            let sizes: Vec<_> = axes.iter().map(|axis| axis.size).collect();
            let what = format!("an array of {} axes, sizes {sizes:?},", sizes.len());
            return Err(ReadError::unsupported(path, what, "write one scalar per sample and one step per file"));
        };
        axes.remove(index);
    }
    Ok(axes)
}

/// The spacing of axis `index`, whose direction must lie along the world axis of that number.
fn along(path: &Path, index: usize, direction: &[f64]) -> Result<f64, ReadError> {
    let spacing = direction.get(index).copied().unwrap_or(f64::NAN);
    let off = |(other, v): (usize, &f64)| other != index && v.abs() > LEAN * spacing.abs();
    if direction.len() == 3 && spacing > 0.0 && !direction.iter().enumerate().any(off) {
        return Ok(spacing);
    }
    let what = format!("axis {index} along {direction:?}");
    Err(ReadError::unsupported(path, what, "resample, so that axes x, y, z run up the world axes in this order"))
}

fn origin(path: &Path, fields: &Fields) -> Result<DVec3, ReadError> {
    let Some(text) = fields.get("spaceorigin") else { return Ok(DVec3::ZERO) };
    match vectors(path, "space origin", text)?.as_slice() {
        [Some(origin)] if origin.len() == 3 => {
            // The format writes "not known" as nan.
            let known = |v: f64| if v.is_nan() { 0.0 } else { v };
            Ok(DVec3::new(known(origin[0]), known(origin[1]), known(origin[2])))
        }
        [None] => Ok(DVec3::ZERO),
        _ => Err(ReadError::damaged(path, format!("\"space origin: {text}\" is no vector of 3 numbers"))),
    }
}

fn numbers<T: std::str::FromStr>(path: &Path, name: &str, text: &str) -> Result<Vec<T>, ReadError> {
    let parsed = text.split_whitespace().map(str::parse).collect::<Result<_, _>>();
    parsed.map_err(|_| ReadError::damaged(path, format!("\"{name}: {text}\" is not a list of fitting numbers")))
}

/// Vectors such as `(1,0,0) none (0,0,2.5)`.
fn vectors(path: &Path, name: &str, text: &str) -> Result<Vec<Option<Vec<f64>>>, ReadError> {
    let wrong = || ReadError::damaged(path, format!("\"{name}: {text}\" is not a list of vectors like (1,0,0)"));
    let (mut vectors, mut rest) = (Vec::new(), text.trim());
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
        } else {
            let (inside, after) = rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(wrong)?;
            let parts = inside.split(',').map(|part| part.trim().parse()).collect::<Result<_, _>>();
            vectors.push(Some(parts.map_err(|_| wrong())?));
            rest = after.trim_start();
        }
    }
    Ok(vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid_of(lines: &str) -> Result<Grid, String> {
        let path = Path::new("a.nrrd");
        let fields = Fields::read(path, format!("NRRD0005\n{lines}\n").as_bytes()).unwrap();
        grid(path, &fields).map_err(|e| e.to_string())
    }

    #[test]
    fn axes_of_size_one_fall_away_and_missing_ones_are_added() {
        let g = grid_of("dimension: 4\nsizes: 1 2 3 4\nspacings: nan 1 0.5 nan").unwrap();
        assert_eq!((g.dims(), g.spacing()), ([2, 3, 4], DVec3::new(1.0, 0.5, 1.0)));
        let g = grid_of("dimension: 4\nsizes: 1 2 3 1\nspace directions: (2,0,0) (0,3,0) (0,0,4) none").unwrap();
        assert_eq!((g.dims(), g.spacing()), ([1, 2, 3], DVec3::new(2.0, 3.0, 4.0)));
        assert_eq!(grid_of("dimension: 2\nsizes: 5 6").unwrap().dims(), [5, 6, 1]);
        assert!(grid_of("dimension: 4\nsizes: 3 2 2 2").unwrap_err().contains("one scalar per sample"));
    }

    #[test]
    fn a_turned_or_mirrored_grid_is_refused() {
        let directed = |d: &str| grid_of(&format!("dimension: 3\nsizes: 2 2 2\nspace directions: {d}"));
        assert!(directed("(1,0,0) (0,1,1e-9) (0,0,1)").is_ok());
        for d in
            ["(-1,0,0) (0,1,0) (0,0,1)", "(0,1,0) (1,0,0) (0,0,1)", "(1,.1,0) (0,1,0) (0,0,1)", "(1,0) (0,1) (0,0)"]
        {
            assert!(directed(d).unwrap_err().contains("resample"), "{d}");
        }
        for d in ["(1,0,0) (0,1,0)", "(1,0,0", "1 0 0", "(a,0,0) none none"] {
            assert!(directed(d).unwrap_err().contains("a.nrrd"), "{d}");
        }
    }
}
