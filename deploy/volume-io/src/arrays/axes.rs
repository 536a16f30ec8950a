//! What the axes of a stored array are: by their names, or by the order that the user states.

use lamina_model::Voxels;
use std::str::FromStr;

/// What a stored axis is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AxisRole {
    X,
    Y,
    Z,
    Time,
    /// None of these: only what has this index is read.
    Index(usize),
}

/// Order of the axes of arrays that do not name them, the slowest first. By default z, y, x.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AxisOrder(pub(super) [AxisRole; 3]);

impl Default for AxisOrder {
    fn default() -> Self {
        Self([AxisRole::Z, AxisRole::Y, AxisRole::X])
    }
}

impl FromStr for AxisOrder {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let roles: Vec<AxisRole> = text.chars().filter_map(|letter| space(&letter.to_string())).collect();
        match <[AxisRole; 3]>::try_from(roles) {
            Ok(order) if text.len() == 3 && names_each_once(&order) => Ok(Self(order)),
            _ => Err(format!("\"{text}\" is no order of axes; state x, y and z, the slowest first, such as zyx")),
        }
    }
}

fn names_each_once(roles: &[AxisRole]) -> bool {
    [AxisRole::X, AxisRole::Y, AxisRole::Z].iter().all(|axis| roles.iter().filter(|role| *role == axis).count() == 1)
}

/// The axis of space of that name, also of those that climate models use.
fn space(name: &str) -> Option<AxisRole> {
    Some(match name.to_ascii_lowercase().as_str() {
        "x" | "lon" | "longitude" => AxisRole::X,
        "y" | "lat" | "latitude" => AxisRole::Y,
        "z" | "lev" | "level" | "depth" | "height" => AxisRole::Z,
        _ => return None,
    })
}

/// Whether an axis of that name is time.
pub(super) fn is_time(name: &str) -> bool {
    matches!(name.to_ascii_lowercase().as_str(), "time" | "t" | "step")
}

/// What the axes of an array are; none, if it is no field of three axes of space. Of an axis along which a vector's three components lie,
/// also which one it is.
pub(super) fn roles(
    shape: &[usize],
    names: Option<&[String]>,
    order: AxisOrder,
) -> Option<(Vec<AxisRole>, Option<usize>)> {
    let named = |n: usize| names.and_then(|names| names.get(n)).map(String::as_str);
    let mut roles: Vec<Option<AxisRole>> = shape.iter().map(|_| None).collect();
    for (n, role) in roles.iter_mut().enumerate() {
        *role = named(n).filter(|name| is_time(name)).map(|_| AxisRole::Time);
    }
    let open = |roles: &[Option<AxisRole>]| roles.iter().filter(|role| role.is_none()).count();
    // Axes of one point that are none of space.
    for n in 0..shape.len() {
        let is_of_space = named(n).and_then(space).is_some();
        if open(&roles) > 3 && roles[n].is_none() && shape[n] == 1 && !is_of_space {
            roles[n] = Some(AxisRole::Index(0));
        }
    }
    // The components of a vector come last or first.
    let may_be_components = |n: &usize| shape[*n] == 3 && roles[*n].is_none() && named(*n).and_then(space).is_none();
    let ends = [shape.len().saturating_sub(1), (0..shape.len()).find(|&n| roles[n].is_none()).unwrap_or(0)];
    let components = ends.into_iter().filter(|_| open(&roles) > 3).find(may_be_components);
    if let Some(n) = components {
        roles[n] = Some(AxisRole::Index(0));
    }
    // A further axis without a name is time.
    if names.is_none() && open(&roles) == 4 && roles[0].is_none() {
        roles[0] = Some(AxisRole::Time);
    }
    if open(&roles) != 3 {
        return None;
    }
    // Names that are known count, unless two are the same; the other axes are in order.
    let known = |n: usize| named(n).and_then(space);
    let by_name: Vec<AxisRole> = (0..shape.len()).filter(|&n| roles[n].is_none()).filter_map(known).collect();
    let is_clear = by_name.iter().all(|role| by_name.iter().filter(|other| *other == role).count() == 1);
    let by_name = if is_clear { by_name } else { Vec::new() };
    let mut others = order.0.into_iter().filter(|role| !by_name.contains(role));
    let role = |(n, role): (usize, Option<AxisRole>)| {
        role.or_else(|| known(n).filter(|role| by_name.contains(role))).or_else(|| others.next())
    };
    let roles: Vec<AxisRole> = roles.into_iter().enumerate().filter_map(role).collect();
    (roles.iter().filter(|&&role| role == AxisRole::Time).count() <= 1).then_some((roles, components))
}

/// Values as a volume has them, x fastest, of values in the order of `roles`; axes that descend are turned round. `dims`: along
/// x, y and z.
pub(super) fn reordered(voxels: Voxels, roles: &[AxisRole], dims: [usize; 3], descends: [bool; 3]) -> Voxels {
    let space: Vec<AxisRole> =
        roles.iter().copied().filter(|role| matches!(role, AxisRole::X | AxisRole::Y | AxisRole::Z)).collect();
    if space == [AxisRole::Z, AxisRole::Y, AxisRole::X] && descends == [false; 3] {
        return voxels;
    }
    // The stride of each axis, and where its first point lies.
    let (mut strides, mut stride, mut first) = ([0isize; 3], 1isize, 0isize);
    for role in space.iter().rev() {
        let axis = [AxisRole::X, AxisRole::Y, AxisRole::Z].iter().position(|axis| axis == role).unwrap_or(0);
        strides[axis] = if descends[axis] { -stride } else { stride };
        first += if descends[axis] { stride * (dims[axis] as isize - 1) } else { 0 };
        stride *= dims[axis] as isize;
    }
    match voxels {
        Voxels::U8(v) => Voxels::U8(gathered(&v, dims, strides, first)),
        Voxels::U16(v) => Voxels::U16(gathered(&v, dims, strides, first)),
        Voxels::I16(v) => Voxels::I16(gathered(&v, dims, strides, first)),
        Voxels::F16(v) => Voxels::F16(gathered(&v, dims, strides, first)),
        Voxels::F32(v) => Voxels::F32(gathered(&v, dims, strides, first)),
        Voxels::F64(v) => Voxels::F64(gathered(&v, dims, strides, first)),
    }
}

/// Points of a side of the blocks that are reordered at a time: source and destination of one stay in the cache.
const BLOCK: usize = 16;

fn gathered<T: Copy + Default>(from: &[T], [nx, ny, nz]: [usize; 3], strides: [isize; 3], first: isize) -> Vec<T> {
    let mut to = vec![T::default(); from.len()];
    let blocks = |n: usize| (0..n).step_by(BLOCK).map(move |start| start..n.min(start + BLOCK));
    for (zs, (ys, xs)) in blocks(nz).flat_map(|z| {
        blocks(ny).flat_map(move |y| blocks(nx).map(move |x| (y.clone(), x))).map(move |yx| (z.clone(), yx))
    }) {
        for (z, y) in zs.flat_map(|z| ys.clone().map(move |y| (z, y))) {
            let row = first + z as isize * strides[2] + y as isize * strides[1];
            let start = (z * ny + y) * nx;
            for x in xs.clone() {
                to[start + x] = from[(row + x as isize * strides[0]) as usize];
            }
        }
    }
    to
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn axes_are_told_by_name_then_by_order() {
        let order: AxisOrder = "xyz".parse().unwrap();
        let of = |shape: &[usize], names: Option<&[String]>, order| roles(shape, names, order).map(|(roles, _)| roles);
        assert_eq!(of(&[2, 3, 4], None, order), Some(vec![AxisRole::X, AxisRole::Y, AxisRole::Z]));
        let climate = names("time lev lat lon");
        let zyx = [AxisRole::Z, AxisRole::Y, AxisRole::X];
        assert_eq!(of(&[9, 2, 3, 4], Some(&climate), order), Some([&[AxisRole::Time][..], &zyx].concat()));
        let strange = names("member a b c");
        let member = Some([&[AxisRole::Index(0)][..], &zyx].concat());
        assert_eq!(of(&[1, 2, 3, 4], Some(&strange), AxisOrder::default()), member);
        assert_eq!(of(&[5, 2, 3, 4], Some(&strange), order), None, "five members, of which none is stated");
        assert_eq!(of(&[5, 2, 3, 4], None, order).unwrap()[0], AxisRole::Time);
        assert_eq!(of(&[2, 3], None, order), None);
        assert_eq!(of(&[1, 3, 4], Some(&names("z y x")), order), Some(zyx.to_vec()));
        let partly = of(&[2, 3, 4], Some(&names("x y altitude")), AxisOrder::default());
        assert_eq!(partly, Some(vec![AxisRole::X, AxisRole::Y, AxisRole::Z]));
        // Vectors.
        let standard = AxisOrder::default();
        let vector = |shape: &[usize]| roles(shape, None, standard).unwrap().1;
        assert_eq!((vector(&[5, 6, 7, 3]), vector(&[3, 6, 7, 8]), vector(&[4, 6, 7, 8])), (Some(3), Some(0), None));
        let (both, at) = roles(&[9, 6, 7, 8, 3], None, standard).unwrap();
        assert_eq!((both[0], at), (AxisRole::Time, Some(4)));
        let named = names("z y x direction");
        assert_eq!(roles(&[5, 6, 7, 3], Some(&named), standard).unwrap().1, Some(3));
        assert_eq!(roles(&[4, 3, 3, 3], Some(&climate), standard).unwrap().1, None);
        for bad in ["xy", "xxz", "zyxx", "abc", "zyx "] {
            assert!(bad.parse::<AxisOrder>().unwrap_err().contains("no order"), "{bad}");
        }
    }

    #[test]
    fn values_are_put_in_order_and_descending_axes_turned() {
        let dims = [19, 5, 33];
        let value = |x: usize, y: usize, z: usize| ((z * dims[1] + y) * dims[0] + x) as f32;
        let wanted: Vec<f32> = (0..19 * 5 * 33).map(|n| n as f32).collect();
        // Stored as x, z, y with z descending.
        let mut stored = Vec::new();
        for x in 0..19 {
            for z in (0..33).rev() {
                stored.extend((0..5).map(|y| value(x, y, z)));
            }
        }
        let roles = [AxisRole::Time, AxisRole::X, AxisRole::Z, AxisRole::Y];
        assert_eq!(reordered(Voxels::F32(stored), &roles, dims, [false, false, true]), Voxels::F32(wanted));
    }
}
