//! Domains of a Blueprint mesh: uniform grids, and rectilinear ones that are evenly spaced; others are resampled or refused by name.
//!
//! A field's values are x fastest, as Blueprint has them, any stride apart; offsets and strides of a field amid ghosts are taken.

use crate::conduit::{Node, NodeArray};
use lamina_model::VoxelType;

/// A field's values on one domain.
#[derive(Debug)]
pub(crate) struct Domain {
    /// Position of its first sample point.
    pub(crate) origin: [f64; 3],
    pub(crate) spacing: [f64; 3],
    /// Sample points per axis.
    pub(crate) dims: [usize; 3],
    pub(crate) values: Values,
}

/// Where the values are.
#[derive(Debug)]
pub(crate) enum Values {
    /// In the simulation's memory, elements from one neighbor to the next.
    InPlace { array: NodeArray, first: usize, strides: [usize; 3] },
    /// Resampled, x fastest.
    Resampled(Vec<f64>),
}

const AXES: [&str; 3] = ["x", "y", "z"];
/// Coordinates off an even spacing by less than this part of it are rounding.
const EVEN: f64 = 1e-4;

/// The domains of channel `channel` with `field`, and the field's name: the first, if none is named. Levels of an adaptive mesh above
/// the coarsest are left out; how many is counted.
pub(crate) fn domains(
    channel: &Node,
    name: &str,
    field: Option<&str>,
) -> Result<(Vec<Domain>, Option<String>, usize), String> {
    let kind = channel.text_at("type").unwrap_or_else(|| "mesh".to_owned());
    let data = channel.at("data").ok_or_else(|| format!("channel {name} has no data"))?;
    let meshes = match kind.as_str() {
        "mesh" => vec![(name.to_owned(), data)],
        "multimesh" | "amrmesh" => data.children(),
        other => return Err(format!("channel {name} is of type {other}; mesh, multimesh and amrmesh are shown")),
    };
    let (mut found, mut chosen, mut finer) = (Vec::new(), field.map(str::to_owned), 0);
    for (name, mesh) in meshes {
        if mesh.number("state/level").is_some_and(|level| level > 0.0) {
            finer += 1;
            continue;
        }
        // A mesh of several domains has them as children; a rank may have none.
        let parts = if mesh.at("coordsets").is_some() { vec![(name, mesh)] } else { mesh.children() };
        for (name, part) in parts.iter().filter(|(_, part)| part.at("fields").is_some()) {
            let (domain, field) = domain(part, name, chosen.as_deref())?;
            chosen = Some(field);
            found.push(domain);
        }
    }
    Ok((found, chosen, finer))
}

fn domain(mesh: &Node, name: &str, wanted: Option<&str>) -> Result<(Domain, String), String> {
    let fields = mesh.at("fields").ok_or_else(|| format!("{name}: no fields"))?.children();
    let names = || fields.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    let scalar = |node: &Node| node.at("values").is_some_and(|values| values.array().is_some());
    // A component of a vector is NAME/COMPONENT.
    let (field_name, component) = match wanted {
        Some(wanted) => wanted.split_once('/').map_or((wanted.to_owned(), None), |(f, c)| (f.to_owned(), Some(c))),
        None => {
            let first = fields.iter().find(|(_, node)| scalar(node));
            (first.ok_or_else(|| format!("{name}: no field of scalars; there are {}", names()))?.0.clone(), None)
        }
    };
    let field = fields.iter().find(|(name, _)| *name == field_name).map(|(_, node)| *node);
    let field = field.ok_or_else(|| format!("{name}: no field {field_name}; there are {}", names()))?;
    let values = field.at("values").ok_or_else(|| format!("{name}: field {field_name} has no values"))?;
    let values = match component {
        Some(component) => values.at(component).ok_or_else(|| format!("{name}: no {component} of {field_name}"))?,
        None => values,
    };
    let array = values.array().ok_or_else(|| {
        let parts =
            values.children().iter().map(|(part, _)| format!("{field_name}/{part}")).collect::<Vec<_>>().join(", ");
        format!("{name}: field {field_name} is not of scalars; name one of {parts}")
    })?;
    if !array.is_readable() {
        return Err(format!(
            "{name}: field {field_name} lies in memory of a device; copy it to the host before catalyst_execute"
        ));
    }
    let topology = field.text_at("topology").unwrap_or_default();
    let topology_node =
        mesh.at(&format!("topologies/{topology}")).ok_or_else(|| format!("{name}: no topology {topology}"))?;
    let coordset = topology_node.text_at("coordset").unwrap_or_default();
    let coordset =
        mesh.at(&format!("coordsets/{coordset}")).ok_or_else(|| format!("{name}: no coordset {coordset}"))?;
    let of_cells = match field.text_at("association").as_deref() {
        Some("element") => true,
        Some("vertex") => false,
        other => {
            return Err(format!(
                "{name}: field {field_name} is of {}; vertex or element is shown",
                other.unwrap_or("no association")
            ));
        }
    };
    let kind = coordset.text_at("type").unwrap_or_default();
    let domain = match kind.as_str() {
        "uniform" => uniform(&coordset, of_cells, name)?.with(&field, array, name)?,
        "rectilinear" => rectilinear(&coordset, of_cells, array, &field, name)?,
        other => {
            return Err(format!(
                "{name}: coordinates of type {other}; uniform and rectilinear ones are shown: resample the field to such a grid"
            ));
        }
    };
    Ok((domain, wanted.map_or(field_name, str::to_owned)))
}

/// A grid without values.
struct SamplePoints {
    origin: [f64; 3],
    spacing: [f64; 3],
    dims: [usize; 3],
}

impl SamplePoints {
    fn with(self, field: &Node, array: NodeArray, name: &str) -> Result<Domain, String> {
        let Self { origin, spacing, dims } = self;
        let three = |path: &str| -> Option<[usize; 3]> {
            let numbers = field.at(path)?.array()?;
            let all: Option<Vec<usize>> = (0..3).map(|n| numbers.get(n).map(|v| v as usize)).collect();
            all?.try_into().ok()
        };
        let strides = three("strides").unwrap_or([1, dims[0], dims[0].saturating_mul(dims[1])]);
        let offsets = three("offsets").unwrap_or_default();
        let reach = |steps: [usize; 3]| {
            let mut sum = 0_usize;
            for (step, stride) in steps.into_iter().zip(strides) {
                sum = sum.checked_add(step.checked_mul(stride)?)?;
            }
            Some(sum)
        };
        let first = reach(offsets);
        let last = first.zip(reach(dims.map(|d| d - 1))).and_then(|(a, b)| a.checked_add(b));
        match (first, last) {
            (Some(first), Some(last)) if last < array.len => {
                Ok(Domain { origin, spacing, dims, values: Values::InPlace { array, first, strides } })
            }
            _ => Err(format!("{name}: {} values for {dims:?} sample points", array.len)),
        }
    }
}

/// Sample points of `points` vertices per axis, or of the cells between them.
fn sampled(mut lattice: SamplePoints, of_cells: bool, name: &str) -> Result<SamplePoints, String> {
    if of_cells {
        for axis in 0..3 {
            lattice.dims[axis] = lattice.dims[axis].saturating_sub(1);
            lattice.origin[axis] += 0.5 * lattice.spacing[axis];
        }
    }
    let finite = lattice.origin.iter().chain(&lattice.spacing).all(|v| v.is_finite());
    if lattice.dims.contains(&0) || !finite || lattice.spacing.iter().any(|s| *s <= 0.0) {
        let SamplePoints { origin, spacing, dims } = lattice;
        return Err(format!("{name}: {dims:?} sample points, {spacing:?} apart, from {origin:?} are no volume"));
    }
    Ok(lattice)
}

fn uniform(coordset: &Node, of_cells: bool, name: &str) -> Result<SamplePoints, String> {
    let mut dims = [0; 3];
    for (axis, index) in ["i", "j", "k"].into_iter().enumerate() {
        let points = coordset.number(&format!("dims/{index}"));
        dims[axis] =
            points.ok_or_else(|| format!("{name}: no dims/{index}; volumes of three axes are shown"))? as usize;
    }
    let origin = AXES.map(|axis| coordset.number(&format!("origin/{axis}")).unwrap_or(0.0));
    let spacing = AXES.map(|axis| coordset.number(&format!("spacing/d{axis}")).unwrap_or(1.0));
    sampled(SamplePoints { origin, spacing, dims }, of_cells, name)
}

fn rectilinear(coordset: &Node, of_cells: bool, array: NodeArray, field: &Node, name: &str) -> Result<Domain, String> {
    let mut points: Vec<Vec<f64>> = Vec::new();
    for axis in AXES {
        let numbers = coordset.at(&format!("values/{axis}")).and_then(|n| n.array());
        let numbers =
            numbers.ok_or_else(|| format!("{name}: no coordinates along {axis}; volumes of three axes are shown"))?;
        let vertices: Vec<f64> = (0..numbers.len).filter_map(|n| numbers.get(n)).collect();
        points.push(if of_cells { vertices.windows(2).map(|w| 0.5 * (w[0] + w[1])).collect() } else { vertices });
    }
    let ends =
        |axis: usize| (points[axis].first().copied().unwrap_or(0.0), points[axis].last().copied().unwrap_or(0.0));
    let dims = std::array::from_fn(|axis| points[axis].len());
    let spacing = std::array::from_fn(|axis| {
        let (first, last) = ends(axis);
        if dims[axis] > 1 { (last - first) / (dims[axis] - 1) as f64 } else { 1.0 }
    });
    let lattice =
        sampled(SamplePoints { origin: std::array::from_fn(|axis| ends(axis).0), spacing, dims }, false, name)?;
    let ascend = points.iter().all(|p| p.windows(2).all(|w| w[0] < w[1]));
    if !ascend {
        return Err(format!("{name}: coordinates do not ascend"));
    }
    let even = points.iter().zip(lattice.spacing).zip(lattice.origin).all(|((p, step), first)| {
        p.iter().enumerate().all(|(n, at)| (at - first - n as f64 * step).abs() <= EVEN * step)
    });
    let domain = lattice.with(field, array, name)?;
    Ok(if even { domain } else { resampled(&domain, &points) })
}

/// The values at even positions, linear between the points they are given at.
fn resampled(domain: &Domain, points: &[Vec<f64>]) -> Domain {
    let Values::InPlace { array, first, strides } = &domain.values else { unreachable!("values are in place") };
    // For each even position the point below it and how far it lies towards the next.
    let places: Vec<Vec<(usize, f64)>> = (0..3)
        .map(|axis| {
            let p = &points[axis];
            (0..domain.dims[axis])
                .map(|n| {
                    let at = domain.origin[axis] + n as f64 * domain.spacing[axis];
                    let below = p.partition_point(|v| *v <= at).clamp(1, p.len().max(2) - 1) - 1;
                    let next = p.get(below + 1).copied().unwrap_or(p[below] + 1.0);
                    (below, ((at - p[below]) / (next - p[below])).clamp(0.0, 1.0))
                })
                .collect()
        })
        .collect();
    let value = |index: [usize; 3]| {
        let offset: usize = (0..3).map(|axis| index[axis].min(domain.dims[axis] - 1) * strides[axis]).sum();
        array.get(first + offset).unwrap_or(f64::NAN)
    };
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let mut values = Vec::with_capacity(domain.dims.iter().product());
    for &(k, tz) in &places[2] {
        for &(j, ty) in &places[1] {
            for &(i, tx) in &places[0] {
                let along_x = |j, k| mix(value([i, j, k]), value([i + 1, j, k]), tx);
                let along_y = |k| mix(along_x(j, k), along_x(j + 1, k), ty);
                values.push(mix(along_y(k), along_y(k + 1), tz));
            }
        }
    }
    Domain { values: Values::Resampled(values), ..*domain }
}

impl Domain {
    /// Its values are of this type once handed over; integers that a run cannot have become double precision.
    pub(crate) fn voxel_type(&self) -> VoxelType {
        match &self.values {
            Values::InPlace { array, .. } => array.element.voxel_type().unwrap_or(VoxelType::F64),
            Values::Resampled(_) => VoxelType::F64,
        }
    }
}
