//! One sample of each ray of a packet, classified.

use super::rays::RayPacket;
use crate::volume::transfer_lut::TransferLut;
use lamina_compute::simd::{Lanes, SMALL_OPTICAL_DEPTH, SimdF32, SimdI32, SimdMask, opacity, small_opacity};

/// Color and opacity of one sample of each ray.
pub(super) struct ShadedSample<L: Lanes> {
    /// Lanes in which the sample is not transparent.
    pub shown: L::M,
    /// Premultiplied color of one unit length.
    pub color: [L::F; 3],
    /// Opacity of one unit length.
    pub unit: L::F,
    /// Optical depth of the sample's length.
    pub depth: L::F,
    /// Opacity of the sample's length over that of a unit length.
    pub ratio: L::F,
    /// Length in steps: 1, or less at the end of a ray.
    pub length: L::F,
}

impl<L: Lanes> ShadedSample<L> {
    /// The sample at row `at` of the table; `None` if it is transparent in all lanes of `live`.
    #[inline(always)]
    pub(super) fn new(table: &TransferLut, packet: &RayPacket<L>, step: L::I, at: L::F, live: L::M) -> Option<Self> {
        let shown = live & table.shown::<L>(at);
        if !shown.any() {
            return None;
        }
        let [r, g, b, unit, mut depth, mut ratio] = L::rows6(&table.unit, at);
        let shown = shown & L::F::splat(0.0).lt(unit);
        let mut length = L::F::splat(1.0);
        let last = shown & step.eq(packet.last);
        if last.any() {
            length = L::F::select(last, L::F::from_array(packet.last_length), length);
            depth = depth * length;
            // For faint samples use the series: the other form has only rounding errors there.
            let large = L::F::splat(SMALL_OPTICAL_DEPTH).lt(depth);
            let part = L::F::select(large, opacity::<L>(depth), small_opacity::<L>(depth));
            ratio = L::F::select(last, part.div(unit), ratio);
        }
        Some(Self { shown, color: [r, g, b], unit, depth, ratio, length })
    }
}
