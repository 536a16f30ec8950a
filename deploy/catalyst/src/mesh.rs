//! Domains of a Blueprint mesh: uniform grids and rectilinear ones that are evenly spaced, as lattices; unevenly spaced, structured and
//! unstructured ones, as cells.
//!
//! A field's values are x fastest, as Blueprint has them, any stride apart; offsets and strides of a field amid ghosts are taken.

use crate::cell_mesh::{CellMesh, Cells, ListedCells, Lists, Points, Ranges, Shapes};
use crate::cells::Shape;
use crate::conduit::{Node, NodeArray};
use crate::strided_grid::StridedGrid;
use glam::DVec3;
use lamina_model::{Grid, VoxelType};

/// A field on one domain.
#[derive(Debug)]
pub(crate) struct Domain {
    pub(crate) geometry: Geometry,
    pub(crate) field: FieldValues,
    /// Of an adaptive mesh: finer levels lie over coarser ones.
    pub(crate) level: Option<u32>,
    /// Which cells are others' or are covered, where that is stated: those of values that are not 0.
    pub(crate) ghosts: Option<FieldValues>,
}

/// Where values lie.
#[derive(Debug)]
pub(crate) enum Geometry {
    /// At the points of a lattice; a field of elements, at their centers.
    EvenGrid(EvenGrid),
    /// At the points or in the cells of a mesh.
    Cells(Box<CellMesh>),
}

/// Sample points, evenly spaced.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct EvenGrid {
    /// Position of the first.
    pub(crate) origin: [f64; 3],
    pub(crate) spacing: [f64; 3],
    /// Sample points per axis.
    pub(crate) dims: [usize; 3],
}

/// Values in the simulation's memory.
#[derive(Debug)]
pub(crate) struct FieldValues {
    pub(crate) array: NodeArray,
    /// A list has one axis.
    pub(crate) layout: StridedGrid,
    pub(crate) of_cells: bool,
}

const AXES: [&str; 3] = ["x", "y", "z"];
/// Fields that mark ghost cells: Ascent's and VTK's.
const GHOSTS: [&str; 2] = ["ascent_ghosts", "vtkGhostType"];
/// Coordinates off an even spacing by less than this part of it are rounding.
const EVEN: f64 = 1e-4;

/// The domains of channel `channel` with `field`, and the field's name: the first, if none is named.
pub(crate) fn domains(
    channel: &Node,
    name: &str,
    field: Option<&str>,
) -> Result<(Vec<Domain>, Option<String>), String> {
    let kind = channel.text_at("type").unwrap_or_else(|| "mesh".to_owned());
    let data = channel.at("data").ok_or_else(|| format!("channel {name} has no data"))?;
    match kind.as_str() {
        "mesh" => domains_of(&[(name.to_owned(), data)], field),
        "multimesh" | "amrmesh" => domains_of(&data.children(), field),
        other => Err(format!("channel {name} is of type {other}; mesh, multimesh and amrmesh are shown")),
    }
}

/// The domains of several meshes.
pub(crate) fn domains_of(
    meshes: &[(String, Node)],
    field: Option<&str>,
) -> Result<(Vec<Domain>, Option<String>), String> {
    let (mut found, mut chosen) = (Vec::new(), field.map(str::to_owned));
    for (name, mesh) in meshes {
        // A mesh of several domains has them as children; a rank may have none.
        let parts = if mesh.at("coordsets").is_some() { vec![(name.clone(), *mesh)] } else { mesh.children() };
        for (name, part) in parts.iter().filter(|(_, part)| part.at("fields").is_some()) {
            let (domain, field) = domain(part, name, chosen.as_deref())?;
            chosen = Some(field);
            found.push(domain);
        }
    }
    Ok((found, chosen))
}

fn domain(mesh: &Node, name: &str, wanted: Option<&str>) -> Result<(Domain, String), String> {
    let fields = mesh.at("fields").ok_or_else(|| format!("{name}: no fields"))?.children();
    let names = || fields.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    let scalar = |node: &Node| node.at("values").is_some_and(|values| values.array().is_some());
    // A component of a vector is NAME/COMPONENT.
    let (field_name, component) = match wanted {
        Some(wanted) => wanted.split_once('/').map_or((wanted.to_owned(), None), |(f, c)| (f.to_owned(), Some(c))),
        None => {
            let first = fields.iter().find(|(name, node)| !GHOSTS.contains(&name.as_str()) && scalar(node));
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
    let topology = field.text_at("topology").unwrap_or_default();
    let topology = mesh
        .at(&format!("topologies/{topology}"))
        .ok_or_else(|| format!("{name}: field {field_name} names topology \"{topology}\", which is not there"))?;
    let coordset = topology.text_at("coordset").unwrap_or_default();
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
    let geometry = match kind.as_str() {
        "uniform" => uniform(&coordset, of_cells).map(Geometry::EvenGrid),
        "rectilinear" => rectilinear(&coordset, of_cells),
        "explicit" => explicit(&coordset, &topology).map(|mesh| Geometry::Cells(Box::new(mesh))),
        other => Err(format!("coordinates of type \"{other}\"; uniform, rectilinear and explicit ones are shown")),
    };
    let geometry = geometry.map_err(|error| format!("{name}: {error}"))?;
    // A level may be stated of any mesh; of an adaptive one there may be one alone, for now.
    let level =
        mesh.number("state/level").or_else(|| mesh.at("nestsets").map(|_| 0.0)).map(|level| level.max(0.0) as u32);
    let values = |of: &str, field: &Node, array: NodeArray, is_of_cells: bool| {
        let dims = match &geometry {
            Geometry::EvenGrid(lattice) => lattice.dims.map(|n| n - usize::from(is_of_cells && !of_cells)),
            Geometry::Cells(mesh) => match &mesh.cells {
                Cells::Grid(grid) => grid.dims.map(|n| n - usize::from(is_of_cells)),
                Cells::Listed(_) if is_of_cells => [mesh.cells(), 1, 1],
                Cells::Listed(_) => [mesh.points.len(), 1, 1],
            },
        };
        FieldValues::new(field, array, is_of_cells, dims).map_err(|error| format!("{name}: field {of}: {error}"))
    };
    let ghosts = fields.iter().find(|(name, node)| {
        GHOSTS.contains(&name.as_str()) && node.text_at("association").as_deref() == Some("element")
    });
    let ghosts = ghosts.and_then(|(name, node)| Some((name, node, node.at("values")?.array()?)));
    let ghosts = ghosts.map(|(of, node, array)| values(of, node, array, true)).transpose()?;
    let field = values(&field_name, &field, array, of_cells)?;
    Ok((Domain { geometry, field, level, ghosts }, wanted.map_or(field_name, str::to_owned)))
}

impl FieldValues {
    fn new(field: &Node, array: NodeArray, of_cells: bool, dims: [usize; 3]) -> Result<Self, String> {
        let array = array.on_host("its values lie")?;
        let layout = StridedGrid::read(field, "", dims, array.len)?;
        let layout = layout.ok_or_else(|| format!("{} values for {dims:?} points or cells", array.len))?;
        Ok(Self { array, layout, of_cells })
    }

    /// The value at a place of a grid.
    pub(crate) fn at(&self, place: [usize; 3]) -> f64 {
        self.array.get(self.layout.at(place)).unwrap_or(f64::NAN)
    }

    /// The value of point or cell `n`, x fastest.
    pub(crate) fn of(&self, n: usize) -> f64 {
        self.array.get(self.layout.of(n)).unwrap_or(f64::NAN)
    }
}

impl Domain {
    /// Its values are of this type once handed over; integers that a run cannot have become double precision.
    pub(crate) fn voxel_type(&self) -> VoxelType {
        self.field.array.element.voxel_type().unwrap_or(VoxelType::F64)
    }
}

impl EvenGrid {
    /// As the grid of a run.
    pub(crate) fn grid(&self) -> Result<Grid, String> {
        let grid = Grid::new(self.dims, DVec3::from(self.spacing), DVec3::from(self.origin));
        grid.map_err(|error| error.to_string())
    }

    /// Checked: points on three axes.
    fn checked(self) -> Result<Self, String> {
        let Self { origin, spacing, dims } = self;
        let finite = origin.iter().chain(&spacing).all(|v| v.is_finite());
        if dims.contains(&0) || !finite || spacing.iter().any(|s| *s <= 0.0) {
            return Err(format!("{dims:?} sample points, {spacing:?} apart, from {origin:?} are no volume"));
        }
        Ok(self)
    }
}

fn uniform(coordset: &Node, of_cells: bool) -> Result<EvenGrid, String> {
    let mut dims = [0; 3];
    for (axis, index) in ["i", "j", "k"].into_iter().enumerate() {
        let points = coordset.number(&format!("dims/{index}"));
        dims[axis] = points.ok_or_else(|| format!("no dims/{index}; volumes of three axes are shown"))? as usize;
    }
    let mut origin = AXES.map(|axis| coordset.number(&format!("origin/{axis}")).unwrap_or(0.0));
    let spacing = AXES.map(|axis| coordset.number(&format!("spacing/d{axis}")).unwrap_or(1.0));
    if of_cells {
        for axis in 0..3 {
            dims[axis] = dims[axis].saturating_sub(1);
            origin[axis] += 0.5 * spacing[axis];
        }
    }
    EvenGrid { origin, spacing, dims }.checked()
}

/// The numbers along one axis.
fn axis_values(coordset: &Node, axis: &str) -> Result<NodeArray, String> {
    let numbers = coordset.at(&format!("values/{axis}")).and_then(|node| node.array());
    let numbers = numbers.ok_or_else(|| format!("no coordinates along {axis}; volumes of three axes are shown"))?;
    numbers.on_host(&format!("coordinates along {axis} lie"))
}

fn rectilinear(coordset: &Node, of_cells: bool) -> Result<Geometry, String> {
    let mut axes: [Vec<f64>; 3] = Default::default();
    for (axis, points) in AXES.into_iter().zip(&mut axes) {
        let numbers = axis_values(coordset, axis)?;
        *points = (0..numbers.len).filter_map(|n| numbers.get(n)).collect();
        if points.windows(2).any(|w| w[0].partial_cmp(&w[1]) != Some(std::cmp::Ordering::Less)) {
            return Err(format!("coordinates along {axis} do not ascend"));
        }
    }
    let (mut origin, mut spacing, mut dims) = ([0.0; 3], [1.0; 3], [0; 3]);
    let mut even = true;
    for (axis, points) in axes.iter().enumerate() {
        let (first, last) = (points[0], points[points.len() - 1]);
        if points.len() > 1 {
            spacing[axis] = (last - first) / (points.len() - 1) as f64;
        }
        let step = spacing[axis];
        even &= points.iter().enumerate().all(|(n, at)| (at - first - n as f64 * step).abs() <= EVEN * step);
        origin[axis] = if of_cells { first + 0.5 * step } else { first };
        dims[axis] = points.len() - usize::from(of_cells);
    }
    let lattice = EvenGrid { origin, spacing, dims }.checked()?;
    if even {
        return Ok(Geometry::EvenGrid(lattice));
    }
    let points = axes.each_ref().map(Vec::len);
    if points.contains(&1) {
        return Err("a single layer of points is no volume".to_owned());
    }
    Ok(Geometry::Cells(Box::new(CellMesh {
        points: Points::Axes(axes),
        cells: Cells::Grid(StridedGrid::dense(points)),
    })))
}

fn explicit(coordset: &Node, topology: &Node) -> Result<CellMesh, String> {
    let mut axes = Vec::new();
    for axis in AXES {
        axes.push(axis_values(coordset, axis)?);
    }
    let axes: [NodeArray; 3] = axes.try_into().map_err(|_| "three axes are shown")?;
    let points = Points::Listed(axes);
    let kind = topology.text_at("type").unwrap_or_default();
    let cells = match kind.as_str() {
        "structured" => {
            let mut dims = [0; 3];
            for (axis, index) in ["i", "j", "k"].into_iter().enumerate() {
                let cells = topology.number(&format!("elements/dims/{index}")).filter(|n| *n >= 1.0 && *n < 1e9);
                dims[axis] = cells.ok_or_else(|| format!("no cells along elements/dims/{index}; volumes are shown"))?
                    as usize
                    + 1;
            }
            let grid = StridedGrid::read(topology, "elements/dims/", dims, points.len())?;
            Cells::Grid(grid.ok_or_else(|| format!("{} positions for a grid of {dims:?} points", points.len()))?)
        }
        "unstructured" => Cells::Listed(Box::new(listed(topology)?)),
        other => return Err(format!("a topology of type \"{other}\"; structured and unstructured ones are shown")),
    };
    Ok(CellMesh { points, cells })
}

/// The lists at `elements` or `subelements`, each of `size` numbers where none are stated.
fn lists(node: &Node, size: Option<usize>) -> Result<Lists, String> {
    let array = |name: &str| {
        node.at(name).and_then(|node| node.array()).map(|a| a.on_host(&format!("{name} lies"))).transpose()
    };
    let all = array("connectivity")?.ok_or("cells without connectivity")?;
    let ranges = match (size, array("sizes")?, array("offsets")?) {
        (Some(size), _, None) => Ranges::Every(size),
        (Some(size), _, Some(offsets)) => Ranges::At { offsets, size },
        (None, Some(sizes), Some(offsets)) => Ranges::Stated { offsets, sizes },
        (None, Some(sizes), None) => {
            let mut starts = vec![0_usize];
            for n in 0..sizes.len {
                let before = starts[starts.len() - 1];
                starts.push(before.saturating_add(sizes.get(n).unwrap_or(0.0).max(0.0) as usize));
            }
            Ranges::Following(starts)
        }
        (None, None, _) => return Err("cells of several sizes without sizes".to_owned()),
    };
    Ok(Lists { all, ranges })
}

fn listed(topology: &Node) -> Result<ListedCells, String> {
    const SHOWN: &str = "tet, pyramid, wedge, hex and polyhedral are shown";
    let of_name = |name: &str| match (Shape::of_name(name), name) {
        (None, "polyhedral") => Ok(None),
        (None, other) => Err(format!("cells of shape \"{other}\"; {SHOWN}")),
        (known, _) => Ok(known),
    };
    let elements = topology.at("elements").ok_or("an unstructured topology without elements")?;
    let name = elements.text_at("shape").ok_or("cells of no one shape; state elements/shape")?;
    let shapes = if name == "mixed" {
        let map = elements.at("shape_map").ok_or("mixed cells without shape_map")?.children();
        let number = |node: &Node| node.array().and_then(|array| array.get(0)).unwrap_or(-1.0);
        // Cells of other shapes, such as of a surface, are left out.
        let known: Vec<_> = map.iter().filter_map(|(name, node)| Some((number(node), of_name(name).ok()?))).collect();
        if known.is_empty() {
            return Err(format!("mixed cells of no shape that is shown; {SHOWN}"));
        }
        let numbers = elements.at("shapes").and_then(|node| node.array()).ok_or("mixed cells without shapes")?;
        Shapes::Numbered(numbers.on_host("shapes lie")?, known)
    } else {
        Shapes::All(of_name(&name)?)
    };
    let (size, polyhedra) = match &shapes {
        Shapes::All(shape) => (shape.map(Shape::vertices), shape.is_none()),
        Shapes::Numbered(_, known) => (None, known.iter().any(|(_, shape)| shape.is_none())),
    };
    let faces = match topology.at("subelements") {
        Some(faces) if polyhedra => {
            let size = match faces.text_at("shape").as_deref() {
                Some("tri") => Some(3),
                Some("quad") => Some(4),
                _ => None,
            };
            Some(lists(&faces, size)?)
        }
        None if polyhedra => return Err("polyhedra without subelements, their faces".to_owned()),
        _ => None,
    };
    Ok(ListedCells { lists: lists(&elements, size)?, shapes, faces })
}
