//! Which pixels of which views are compared: stratified random samples, so that quality costs a small part of an image.

use crate::{Camera, Image, Invalid, Scene};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Batches of one random pixel in every `tile` x `tile` block of a square image, for each of some views. Batches are
/// independent of each other: any number of them is a sample of the whole image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SamplePlan {
    /// Side of the image the samples stand for, pixels.
    pub image_size: u32,
    /// Side of a block, pixels; 1 compares every pixel.
    pub tile: u32,
    /// Batches; 1 where every pixel is compared.
    pub batches: u32,
    /// Views: rotations of the generation camera about +y through its target, degrees.
    pub angles_deg: Vec<f64>,
}

impl Default for SamplePlan {
    /// The paper's views, 10..60 degrees at 768 x 768, one pixel in 64, in 16 batches.
    fn default() -> Self {
        Self { image_size: 768, tile: 32, batches: 16, angles_deg: vec![10.0, 20.0, 30.0, 40.0, 50.0, 60.0] }
    }
}

impl SamplePlan {
    /// Every pixel of six views of 256 x 256, as structural similarity needs.
    pub fn whole_views() -> Self {
        Self { image_size: 256, tile: 1, batches: 1, ..Self::default() }
    }

    /// True if every pixel is compared.
    pub fn is_whole(&self) -> bool {
        self.tile == 1
    }

    /// The most views of a plan.
    pub const MAX_VIEWS: usize = 64;
    /// The most batches of a plan.
    pub const MAX_BATCHES: u32 = 256;

    /// Passes a plan that can be carried out.
    ///
    /// # Errors
    /// If the image size, the tile, or an angle is out of bounds.
    pub fn check(self) -> Result<Self, Invalid> {
        Image::check_size(self.image_size, self.image_size)?;
        if !(1..=self.image_size).contains(&self.tile) {
            return Err(Invalid::new(
                "samples.tile",
                format!("{} must lie in 1..={} pixels", self.tile, self.image_size),
            ));
        }
        if !(1..=Self::MAX_BATCHES).contains(&self.batches) {
            let most = Self::MAX_BATCHES;
            return Err(Invalid::new("samples.batches", format!("{} must lie in 1..={most}", self.batches)));
        }
        if self.tile == 1 && self.batches > 1 {
            let batches = self.batches;
            return Err(Invalid::new(
                "samples.batches",
                format!("{batches} batches of every pixel tell no more than one; with tile = 1 give batches = 1"),
            ));
        }
        if self.angles_deg.is_empty() || self.angles_deg.len() > Self::MAX_VIEWS {
            let n = self.angles_deg.len();
            return Err(Invalid::new(
                "samples.angles_deg",
                format!("{n} views given; 1 to {} are needed", Self::MAX_VIEWS),
            ));
        }
        if let Some(a) = self.angles_deg.iter().find(|a| !a.is_finite()) {
            return Err(Invalid::new("samples.angles_deg", format!("{a} must be finite")));
        }
        Ok(self)
    }

    /// The test camera of each view.
    ///
    /// # Errors
    /// If an angle is not finite.
    pub fn test_cameras(&self, generation_camera: &Camera) -> Result<Vec<Camera>, Invalid> {
        self.angles_deg.iter().map(|&a| generation_camera.rotated_about_y(a)).collect()
    }

    /// The sampled pixels (column, row) of one batch of view number `view`: the same on every machine.
    pub fn pixels(&self, view: usize, batch: u32) -> Vec<(u32, u32)> {
        let blocks = self.image_size.div_ceil(self.tile);
        let mut pixels = Vec::with_capacity(self.samples_per_batch());
        for (by, bx) in (0..blocks).flat_map(|y| (0..blocks).map(move |x| (y, x))) {
            let side = |b: u32| self.tile.min(self.image_size - b * self.tile);
            let random =
                splitmix64(((view as u64) << 56) ^ (u64::from(batch) << 48) ^ (u64::from(by) << 24) ^ u64::from(bx));
            let pick = |bits: u64, n: u32| (((bits & 0xffff_ffff) * u64::from(n)) >> 32) as u32;
            pixels.push((bx * self.tile + pick(random, side(bx)), by * self.tile + pick(random >> 32, side(by))));
        }
        pixels
    }

    /// `count` batches from `first` on.
    ///
    /// # Errors
    /// If the plan has not so many.
    pub fn slice(&self, first: u32, count: u32) -> Result<Range<u32>, Invalid> {
        let end = first.checked_add(count).filter(|&end| end <= self.batches);
        let missing =
            || Invalid::new("reference", format!("batches {first} and {count} more are not among {}", self.batches));
        Ok(first..end.ok_or_else(missing)?)
    }

    /// `count` batches that rotate from step to step, so that successive steps are sampled at other pixels.
    pub fn rotating_slice(&self, step: u64, count: u32) -> Range<u32> {
        let count = count.clamp(1, self.batches);
        let slices = self.batches / count;
        let first = (step % u64::from(slices)) as u32 * count;
        first..first + count
    }

    /// Samples of one view, all batches.
    pub fn samples_per_view(&self) -> usize {
        self.samples_per_batch() * self.batches as usize
    }

    /// Samples of one batch of one view.
    pub fn samples_per_batch(&self) -> usize {
        (self.image_size.div_ceil(self.tile) as usize).pow(2)
    }
}

/// The output function of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): a bijective hash of 64 bits.
fn splitmix64(seed: u64) -> u64 {
    let z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Ray-cast colors at the pixels of a plan: what a VDI's pictures are compared with.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceSamples {
    /// The step they show.
    pub step: u64,
    /// Which pixels.
    pub plan: SamplePlan,
    /// What was seen: generation camera, transfer function and background.
    pub scene: Scene,
    /// The plan's batches that are here: all of them, or a slice.
    pub batches: Range<u32>,
    /// Colors per view: batch after batch, each in the order of [`SamplePlan::pixels`].
    pub colors: Vec<Vec<[f32; 3]>>,
}

impl ReferenceSamples {
    /// Colors of some batches of view number `view`; `None` unless all of them are here.
    pub fn batch_colors(&self, view: usize, batches: &Range<u32>) -> Option<&[[f32; 3]]> {
        let first = batches.start.checked_sub(self.batches.start)? as usize;
        let size = self.plan.samples_per_batch();
        let colors = self.colors.get(view)?;
        (batches.end <= self.batches.end).then(|| colors.get(first * size..(first + batches.len()) * size))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_block_holds_one_sample_and_tile_one_is_every_pixel() {
        let plan = SamplePlan { image_size: 21, tile: 4, batches: 2, angles_deg: vec![10.0] };
        let pixels = plan.pixels(0, 0);
        assert_eq!(pixels.len(), plan.samples_per_batch());
        assert_eq!(2 * pixels.len(), plan.samples_per_view());
        assert_ne!(pixels, plan.pixels(0, 1));
        for (n, &(x, y)) in pixels.iter().enumerate() {
            assert_eq!((x / 4 + 6 * (y / 4)) as usize, n);
            assert!(x < 21 && y < 21);
        }
        assert_ne!(pixels, plan.pixels(1, 0));
        let plan = SamplePlan { batches: 5, ..plan };
        assert_eq!([0, 1, 2, 3].map(|step| plan.rotating_slice(step, 2)), [0..2, 2..4, 0..2, 2..4]);
        assert_eq!((plan.rotating_slice(7, 9), plan.rotating_slice(7, 0)), (0..5, 2..3));
        let all = SamplePlan { tile: 1, ..plan };
        assert_eq!(all.pixels(0, 0)[22], (1, 1));
    }
}
