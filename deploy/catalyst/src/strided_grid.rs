//! Where the elements of a grid lie in a list: x fastest, or any strides apart, amid ghosts.

use crate::conduit::Node;

/// The elements of a grid in a list.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StridedGrid {
    /// Elements per axis.
    pub(crate) dims: [usize; 3],
    /// The first of the grid, in the list.
    pub(crate) first: usize,
    /// From one neighbor to the next.
    pub(crate) strides: [usize; 3],
}

impl StridedGrid {
    /// Of elements that lie x fastest.
    pub(crate) fn dense(dims: [usize; 3]) -> Self {
        Self { dims, first: 0, strides: [1, dims[0], dims[0].saturating_mul(dims[1])] }
    }

    /// By the offsets and strides that `node` may state at `prefix`, in a list of `len`; none, where it ends beyond the list.
    ///
    /// # Errors
    /// If they lie in memory of a device.
    pub(crate) fn read(node: &Node, prefix: &str, dims: [usize; 3], len: usize) -> Result<Option<Self>, String> {
        let stated = |name: &str| three(node, &format!("{prefix}{name}"));
        let strides = stated("strides")?.unwrap_or(Self::dense(dims).strides);
        let offsets = stated("offsets")?.unwrap_or_default();
        let reach = |steps: [usize; 3]| {
            let all = steps.into_iter().zip(strides).map(|(step, stride)| step.checked_mul(stride));
            all.reduce(|sum, part| sum?.checked_add(part?)).flatten()
        };
        let (first, span) = (reach(offsets), reach(dims.map(|d| d.saturating_sub(1))));
        let fits = |(first, span): (usize, usize)| first.checked_add(span).is_some_and(|last| last < len);
        Ok(first.zip(span).filter(|reach| fits(*reach)).map(|(first, _)| Self { dims, first, strides }))
    }

    /// The element at a place of the grid.
    pub(crate) fn at(&self, place: [usize; 3]) -> usize {
        self.first + place.iter().zip(self.strides).map(|(n, stride)| n * stride).sum::<usize>()
    }

    /// Element `n`, x fastest.
    pub(crate) fn of(&self, n: usize) -> usize {
        let [x, y, _] = self.dims;
        if self.strides == [1, x, x * y] { self.first + n } else { self.at([n % x, n / x % y, n / (x * y)]) }
    }
}

/// Three numbers at `path`, if there are any.
fn three(node: &Node, path: &str) -> Result<Option<[usize; 3]>, String> {
    let Some(numbers) = node.at(path).and_then(|node| node.array()) else { return Ok(None) };
    let numbers = numbers.on_host(&format!("{path} lie"))?;
    let all: Option<Vec<usize>> = (0..3).map(|n| numbers.get(n).map(|v| v as usize)).collect();
    Ok(all.and_then(|all| all.try_into().ok()))
}
