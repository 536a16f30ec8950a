//! Structural similarity of two pictures: how alike their local means, contrasts and structures are, which follows what people see
//! more closely than squared differences do.
//!
//! Z. Wang, A. Bovik, H. Sheikh and E. Simoncelli, "Image Quality Assessment: From Error Visibility to Structural Similarity", IEEE
//! Trans. Image Processing 13(4), 2004: Gaussian windows of 11 x 11 pixels and deviation 1.5, K1 = 0.01, K2 = 0.03, the range of a
//! channel 1. Means are over all windows that lie within the picture, and over red, green and blue.

use crate::{Image, Invalid};
use std::array::from_fn;

/// Side of the window, pixels.
pub const WINDOW: usize = 11;
/// Standard deviation of its weights, pixels.
const DEVIATION: f64 = 1.5;
/// (K1 L)^2 and (K2 L)^2.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Exponents of the scales, the finest first: Wang, Simoncelli and Bovik, "Multiscale Structural Similarity for Image Quality
/// Assessment", Asilomar 2003, section 3.2.
const SCALES: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

/// The least side of a picture for [`ms_ssim`], pixels: a window fits into it at the coarsest scale.
pub const LEAST_SIDE_OF_SCALES: u32 = (WINDOW as u32) << (SCALES.len() - 1);

/// SSIM of two pictures: 1 if they are identical, near 0 if they have nothing in common, below 0 if one is the other's negative.
///
/// # Errors
/// If their sizes differ, or a side is below 11 pixels.
pub fn ssim(a: &Image, b: &Image) -> Result<f64, Invalid> {
    check(a, b, WINDOW as u32)?;
    let similarity = channels(a, b).map(|planes| planes.similarity());
    Ok(similarity.map(|s| s.luminance_and_structure).iter().sum::<f64>() / 3.0)
}

/// Multi-scale SSIM: contrast and structure at five scales, each of half the side of the one before, and luminance at the coarsest.
/// Where structures are opposed at a scale it counts as 0 there.
///
/// # Errors
/// If their sizes differ, or a side is below 176 pixels.
pub fn ms_ssim(a: &Image, b: &Image) -> Result<f64, Invalid> {
    check(a, b, LEAST_SIDE_OF_SCALES)?;
    let of = |mut planes: Planes| {
        let mut product = 1.0;
        for (scale, exponent) in SCALES.into_iter().enumerate() {
            let similarity = planes.similarity();
            let last = scale + 1 == SCALES.len();
            let value = if last { similarity.luminance_and_structure } else { similarity.structure };
            product *= value.max(0.0).powf(exponent);
            if !last {
                planes = planes.halved();
            }
        }
        product
    };
    Ok(channels(a, b).map(of).iter().sum::<f64>() / 3.0)
}

fn check(a: &Image, b: &Image, least: u32) -> Result<(), Invalid> {
    let [(aw, ah), (bw, bh)] = [a, b].map(|image| (image.width(), image.height()));
    if (aw, ah) != (bw, bh) {
        return Err(Invalid::new("images", format!("sizes differ: {aw} x {ah} and {bw} x {bh}")));
    }
    if aw.min(ah) < least {
        return Err(Invalid::new("images", format!("{aw} x {ah} is too small; sides of {least} pixels are needed")));
    }
    Ok(())
}

fn channels(a: &Image, b: &Image) -> [Planes; 3] {
    let plane = |image: &Image, c: usize| image.pixels().iter().map(|p| f64::from(p[c])).collect();
    from_fn(|c| Planes { width: a.width() as usize, a: plane(a, c), b: plane(b, c) })
}

/// One channel of both pictures, row by row.
struct Planes {
    width: usize,
    a: Vec<f64>,
    b: Vec<f64>,
}

/// Means over all windows.
#[derive(Clone, Copy)]
struct Similarity {
    luminance_and_structure: f64,
    structure: f64,
}

impl Planes {
    fn similarity(&self) -> Similarity {
        let weights = weights();
        let product = |x: &[f64], y: &[f64]| x.iter().zip(y).map(|(x, y)| x * y).collect::<Vec<_>>();
        let filter = |plane: &[f64]| filtered(plane, self.width, &weights);
        let [mean_a, mean_b] = [&self.a, &self.b].map(|plane| filter(plane));
        let [aa, bb, ab] =
            [(&self.a, &self.a), (&self.b, &self.b), (&self.a, &self.b)].map(|(x, y)| filter(&product(x, y)));
        let (mut both, mut structure) = (0.0, 0.0);
        for k in 0..mean_a.len() {
            let (ma, mb) = (mean_a[k], mean_b[k]);
            let variances = (aa[k] - ma * ma) + (bb[k] - mb * mb);
            let s = (2.0 * (ab[k] - ma * mb) + C2) / (variances + C2);
            structure += s;
            both += s * (2.0 * ma * mb + C1) / (ma * ma + mb * mb + C1);
        }
        let n = mean_a.len() as f64;
        Similarity { luminance_and_structure: both / n, structure: structure / n }
    }

    /// Means of 2 x 2 pixels; an odd last row or column is left out.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.a.len() / self.width / 2);
        let half = |plane: &[f64]| {
            let at = |x: usize, y: usize| plane[y * self.width + x];
            let mean = |x: usize, y: usize| 0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1));
            (0..height).flat_map(|y| (0..width).map(move |x| (2 * x, 2 * y))).map(|(x, y)| mean(x, y)).collect()
        };
        Self { width, a: half(&self.a), b: half(&self.b) }
    }
}

/// Weights of a window along one axis, of sum 1.
fn weights() -> [f64; WINDOW] {
    let weight = |k: usize| (-0.5 * ((k as f64 - (WINDOW / 2) as f64) / DEVIATION).powi(2)).exp();
    let sum: f64 = (0..WINDOW).map(weight).sum();
    from_fn(|k| weight(k) / sum)
}

/// Weighted means over the windows that lie within a plane, first along its rows, then along its columns.
fn filtered(plane: &[f64], width: usize, weights: &[f64; WINDOW]) -> Vec<f64> {
    let inner = width + 1 - WINDOW;
    let mut rows = Vec::with_capacity(plane.len() / width * inner);
    for row in plane.chunks_exact(width) {
        rows.extend(row.windows(WINDOW).map(|w| w.iter().zip(weights).map(|(v, weight)| v * weight).sum::<f64>()));
    }
    let mut means = vec![0.0; rows.len() - (WINDOW - 1) * inner];
    for (k, weight) in weights.iter().enumerate() {
        means.iter_mut().zip(&rows[k * inner..]).for_each(|(mean, v)| *mean += weight * v);
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(side: u32, color: impl Fn(u32, u32) -> f32) -> Image {
        let pixels = (0..side * side).map(|n| [color(n % side, n / side); 3]).collect();
        Image::new(side, side, pixels).unwrap()
    }

    #[test]
    fn identical_pictures_are_one_and_uniform_ones_follow_the_luminance_term() {
        let ramp = image(200, |x, y| (x * 3 + y * 7) as f32 % 11.0 / 11.0);
        assert!(
            (ssim(&ramp, &ramp).unwrap() - 1.0).abs() < 1e-12 && (ms_ssim(&ramp, &ramp).unwrap() - 1.0).abs() < 1e-12
        );
        // Without variance only luminance differs: (2 ab + C1) / (a^2 + b^2 + C1).
        let [a, b] = [0.25, 0.75].map(|v| image(176, |_, _| v));
        let luminance = (2.0 * 0.25 * 0.75 + 1e-4) / (0.25 * 0.25 + 0.75 * 0.75 + 1e-4);
        assert!((ssim(&a, &b).unwrap() - luminance).abs() < 1e-9);
        assert!((ms_ssim(&a, &b).unwrap() - luminance.powf(0.1333)).abs() < 1e-9);
    }

    #[test]
    fn a_negative_has_opposed_structure_and_a_shift_of_brightness_keeps_it() {
        let stripes = |low: f32, high: f32| image(64, move |x, _| if x % 2 == 0 { low } else { high });
        let (a, negative, brighter) = (stripes(0.2, 0.4), stripes(0.4, 0.2), stripes(0.5, 0.7));
        assert!(ssim(&a, &negative).unwrap() < -0.8);
        let [shifted, same] = [&brighter, &a].map(|b| ssim(&a, b).unwrap());
        assert!(shifted < same && shifted > 0.7, "{shifted}");
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let of = |side| image(side, |_, _| 0.5);
        assert!(ssim(&of(11), &of(11)).is_ok() && ssim(&of(10), &of(10)).is_err() && ssim(&of(11), &of(12)).is_err());
        assert!(ms_ssim(&of(176), &of(176)).is_ok());
        assert!(ms_ssim(&of(175), &of(175)).unwrap_err().to_string().contains("176"));
    }
}
