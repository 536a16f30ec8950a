//! Division of a picture into packets of neighboring rays, drawn on all cores.

use super::cubic::colors;
use super::ray_setup::RaySetup;
use lamina_compute::simd::{Lanes, Level, SimdKernel, WIDTH};
use rayon::prelude::*;
use std::ops::Range;

/// Side, in pixels, of the square tile that one core draws at a time: neighboring rays meet the same lists.
const TILE: usize = 16;

/// Renders some rows of a picture of width `w`.
pub(super) fn picture(level: Level, setup: &RaySetup, w: u32, rows: Range<u32>) -> Vec<[f32; 3]> {
    let (w, first) = (w as usize, rows.start as usize);
    let mut pixels = vec![setup.vdi.header().background; w * rows.len()];
    pixels.par_chunks_mut(w * TILE).enumerate().for_each(|(band, rows)| {
        level.run(PictureBand { setup, width: w, top: first + band * TILE, rows });
    });
    pixels
}

/// Renders some `pixels` (column, row); returns their colors in order.
pub(super) fn listed(level: Level, setup: &RaySetup, pixels: &[(u32, u32)]) -> Vec<[f32; 3]> {
    let mut colors = vec![[0.0; 3]; pixels.len()];
    let some = (pixels.par_chunks(256), colors.par_chunks_mut(256));
    some.into_par_iter().for_each(|(pixels, out)| level.run(PixelList { setup, pixels, out }));
    colors
}

/// Kernel: consecutive rows of a picture.
struct PictureBand<'a> {
    setup: &'a RaySetup<'a>,
    width: usize,
    top: usize,
    rows: &'a mut [[f32; 3]],
}

impl SimdKernel for PictureBand<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (w, height) = (self.width, self.rows.len() / self.width);
        let mut packet = [(0, 0); WIDTH];
        for left in (0..w).step_by(TILE) {
            let right = w.min(left + TILE);
            // A tile whose rays all miss the VDI stays background.
            let (x, y) = ([left as f64, right as f64], [self.top as f64, (self.top + height) as f64]);
            let Some(clip) = self.setup.clip.of_tile(x, y) else { continue };
            let [columns, rows] = self.setup.packet(0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]));
            for first_row in (0..height).step_by(rows) {
                for first_column in (left..right).step_by(columns) {
                    let mut count = 0;
                    for j in first_row..height.min(first_row + rows) {
                        for i in first_column..right.min(first_column + columns) {
                            packet[count] = (i as u32, (self.top + j) as u32);
                            count += 1;
                        }
                    }
                    let colors = colors::<L>(self.setup, &clip, &packet[..count]);
                    for (&(i, j), color) in packet[..count].iter().zip(colors) {
                        self.rows[(j as usize - self.top) * w + i as usize] = color;
                    }
                }
            }
        }
    }
}

/// Kernel: a list of pixels.
struct PixelList<'a> {
    setup: &'a RaySetup<'a>,
    pixels: &'a [(u32, u32)],
    out: &'a mut [[f32; 3]],
}

impl SimdKernel for PixelList<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (pixels, out) in self.pixels.chunks(WIDTH).zip(self.out.chunks_mut(WIDTH)) {
            let colors = colors::<L>(self.setup, &self.setup.clip, pixels);
            out.copy_from_slice(&colors[..out.len()]);
        }
    }
}
