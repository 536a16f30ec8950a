//! Which points of the whole grid each domain hands over: where domains share points, such as the vertices of a face or a halo, the
//! shared layer is cut in the middle.

/// Points `start` to before `end` of a lattice, per axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct IndexBox {
    pub(crate) start: [i64; 3],
    pub(crate) end: [i64; 3],
}

impl IndexBox {
    /// What both have; `None` if nothing.
    fn shared(&self, other: &Self) -> Option<Self> {
        let start = std::array::from_fn(|axis| self.start[axis].max(other.start[axis]));
        let end = std::array::from_fn(|axis| self.end[axis].min(other.end[axis]));
        (0..3).all(|axis| start[axis] < end[axis]).then_some(Self { start, end })
    }

    /// Points per axis.
    pub(crate) fn dims(&self) -> [i64; 3] {
        std::array::from_fn(|axis| self.end[axis] - self.start[axis])
    }

    /// The least box that holds all; `None` of none.
    pub(crate) fn around(boxes: &[Self]) -> Option<Self> {
        let mut all = *boxes.first()?;
        for one in boxes {
            for axis in 0..3 {
                all.start[axis] = all.start[axis].min(one.start[axis]);
                all.end[axis] = all.end[axis].max(one.end[axis]);
            }
        }
        Some(all)
    }
}

/// The boxes without shared points: a layer that two share along one axis is cut in the middle, the lower box's part first.
///
/// # Errors
/// If two share points in any other way.
pub(crate) fn disjoint(boxes: &[IndexBox]) -> Result<Vec<IndexBox>, String> {
    let mut cut = boxes.to_vec();
    for (n, one) in boxes.iter().enumerate() {
        for (m, other) in boxes.iter().enumerate().skip(n + 1) {
            let Some(shared) = one.shared(other) else { continue };
            // The axis along which one follows on the other: each has points that the other has not. At edges and corners there are
            // several, and neighbors at faces cut there.
            let follows: Vec<usize> = (0..3)
                .filter(|&axis| one.start[axis] != other.start[axis] && one.end[axis] != other.end[axis])
                .filter(|&axis| (one.start[axis] < other.start[axis]) == (one.end[axis] < other.end[axis]))
                .collect();
            let [axis] = follows[..] else { continue };
            let middle = shared.start[axis] + (shared.end[axis] - shared.start[axis]) / 2;
            let (lower, upper) = if one.start[axis] < other.start[axis] { (n, m) } else { (m, n) };
            cut[lower].end[axis] = cut[lower].end[axis].min(middle);
            cut[upper].start[axis] = cut[upper].start[axis].max(middle);
        }
    }
    for (n, one) in cut.iter().enumerate() {
        if let Some(other) = cut[n + 1..].iter().find(|other| one.shared(other).is_some()) {
            return Err(format!(
                "domains overlap by more than a layer: points {:?} to {:?} and {:?} to {:?}; state which are ghosts by smaller domains",
                one.start, one.end, other.start, other.end
            ));
        }
    }
    Ok(cut)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(start: [i64; 3], end: [i64; 3]) -> IndexBox {
        IndexBox { start, end }
    }

    /// How many of the boxes hold each point of their hull.
    fn counts(boxes: &[IndexBox]) -> Vec<usize> {
        let hull = IndexBox::around(boxes).unwrap();
        let mut counts = Vec::new();
        for z in hull.start[2]..hull.end[2] {
            for y in hull.start[1]..hull.end[1] {
                for x in hull.start[0]..hull.end[0] {
                    let point = of([x, y, z], [x + 1, y + 1, z + 1]);
                    counts.push(boxes.iter().filter(|b| b.shared(&point).is_some()).count());
                }
            }
        }
        counts
    }

    #[test]
    fn every_point_of_a_decomposition_with_shared_layers_is_handed_over_once() {
        // Eight blocks of 5 cells a side: vertices 0..=5 and 5..=10, then with halos of 1 and 2 layers beyond.
        for halo in [0, 1, 2] {
            let parts = [(0, 6 + halo), (5 - halo, 11)];
            let mut boxes = Vec::new();
            for z in parts {
                for y in parts {
                    for x in parts {
                        boxes.push(of([x.0, y.0, z.0], [x.1, y.1, z.1]));
                    }
                }
            }
            let cut = disjoint(&boxes).unwrap();
            assert!(counts(&cut).iter().all(|n| *n == 1), "halo {halo}: {cut:?}");
        }
    }

    #[test]
    fn boxes_that_share_nothing_stay_as_they_are() {
        let boxes = [of([0; 3], [4, 4, 4]), of([4, 0, 0], [9, 4, 4]), of([0, 4, 0], [9, 7, 4])];
        assert_eq!(disjoint(&boxes).unwrap(), boxes);
    }

    #[test]
    fn one_box_inside_of_another_is_refused() {
        let error = disjoint(&[of([0; 3], [9; 3]), of([2; 3], [4; 3])]).unwrap_err();
        assert!(error.contains("overlap"), "{error}");
    }
}
