//! The Volumetric Depth Image: per ray a depth-ordered list of supersegments. The paper's M.

use crate::{Aabb, Camera, Invalid, VdiParams, composite};

/// A run of samples on one ray that are alike. Depths count sampling steps from the ray's entry into the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Supersegment {
    /// First step inside.
    pub start: u32,
    /// First step beyond; above `start`.
    pub end: u32,
    /// Straight color, RGB in 0..1.
    pub color: [f32; 3],
    /// Optical depth of its whole length, positive; infinity is opaque.
    pub optical_depth: f32,
}

impl Supersegment {
    /// Opacity of its whole length.
    pub fn opacity(&self) -> f64 {
        composite::opacity_from_optical_depth(f64::from(self.optical_depth))
    }
}

/// All that is needed to place a VDI's rays and depths in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VdiHeader {
    /// The generation camera; its image is square.
    pub camera: Camera,
    /// The volume's box, where depths start to count.
    pub bounds: Aabb,
    /// World length of one step.
    pub step_length: f64,
    /// How it was generated.
    pub params: VdiParams,
    /// [`crate::TransferFunction::id`] of what colored it.
    pub transfer_id: u64,
    /// Color behind everything.
    pub background: [f32; 3],
}

impl VdiHeader {
    /// The most steps a ray may have, so that depths and their sums stay exact everywhere.
    pub const MAX_STEPS: u32 = 1 << 24;

    /// Passes a header whose numbers fit together.
    ///
    /// # Errors
    /// If the step is not positive or so short that a ray would take more than [`Self::MAX_STEPS`] of them.
    pub fn check(self) -> Result<Self, Invalid> {
        Aabb::new(self.bounds.min, self.bounds.max)?;
        let steps = self.bounds.size().length() / self.step_length;
        if !(self.step_length > 0.0 && steps < f64::from(Self::MAX_STEPS)) {
            let (l, max) = (self.step_length, Self::MAX_STEPS);
            return Err(Invalid::new(
                "step",
                format!("length {l} gives {steps:.0} steps through the box; at most {max}"),
            ));
        }
        if !self.background.iter().all(|c| (0.0..=1.0).contains(c)) {
            return Err(Invalid::new("background", "every channel must lie in 0..1"));
        }
        Ok(self)
    }

    /// Entry and exit distance of ray (`i`, `j`) through the box.
    pub fn ray_span(&self, i: u32, j: u32) -> Option<(f64, f64)> {
        let r = self.params.resolution();
        self.bounds.clip(&self.camera.pixel_ray(i, j, r, r))
    }

    /// Number of steps that cover a ray's length in the box: whole ones, and a shorter last one for any rest.
    pub fn steps(&self, length: f64) -> u32 {
        steps(length, self.step_length)
    }
}

/// A rest of a ray below this share of a step is rounding, not a step.
pub const STEP_ROUNDING: f64 = 1e-9;

/// Number of steps of `step_length` that cover `length`. A rest below [`STEP_ROUNDING`] is none.
pub fn steps(length: f64, step_length: f64) -> u32 {
    (length / step_length - STEP_ROUNDING).ceil().max(0.0) as u32
}

/// A Volumetric Depth Image of r x r rays, row by row from the upper left. The paper's M.
#[doc(alias = "M")]
#[derive(Debug, Clone, PartialEq)]
pub struct Vdi {
    header: VdiHeader,
    offsets: Vec<u32>,
    segments: Vec<Supersegment>,
}

impl Vdi {
    /// Joins lists: ray n owns `segments[offsets[n]..offsets[n + 1]]`.
    ///
    /// # Errors
    /// If the offsets do not fit the rays and segments, or a list is not ordered, overlaps, or holds impossible numbers.
    pub fn new(header: VdiHeader, offsets: Vec<u32>, segments: Vec<Supersegment>) -> Result<Self, Invalid> {
        let header = header.check()?;
        let rays = (header.params.resolution() as usize).pow(2);
        let fits = offsets.len() == rays + 1
            && offsets[0] == 0
            && offsets[rays] as usize == segments.len()
            && offsets.windows(2).all(|w| w[0] <= w[1]);
        if !fits {
            return Err(Invalid::new(
                "vdi",
                format!("list offsets do not fit {rays} rays and {} supersegments", segments.len()),
            ));
        }
        for w in offsets.windows(2) {
            let mut depth = 0;
            for s in &segments[w[0] as usize..w[1] as usize] {
                let colors = s.color.iter().all(|c| (0.0..=1.0).contains(c));
                if s.start < depth
                    || s.end <= s.start
                    || s.end > VdiHeader::MAX_STEPS
                    || s.optical_depth.is_nan()
                    || s.optical_depth < 0.0
                    || !colors
                {
                    return Err(Invalid::new("vdi", format!("{s:?} after depth {depth} is not a supersegment")));
                }
                depth = s.end;
            }
        }
        Ok(Self { header, offsets, segments })
    }

    /// Where its rays and depths lie.
    #[inline]
    pub fn header(&self) -> &VdiHeader {
        &self.header
    }
    /// Rays per side.
    #[inline]
    pub fn resolution(&self) -> u32 {
        self.header.params.resolution()
    }
    /// Where each ray's list starts; r * r + 1 numbers.
    pub fn offsets(&self) -> &[u32] {
        &self.offsets
    }
    /// All lists, one after the other.
    pub fn segments(&self) -> &[Supersegment] {
        &self.segments
    }
    /// The list of ray (`i`, `j`), nearest first.
    #[inline]
    pub fn list(&self, i: u32, j: u32) -> &[Supersegment] {
        let n = j as usize * self.resolution() as usize + i as usize;
        &self.segments[self.offsets[n] as usize..self.offsets[n + 1] as usize]
    }
}
