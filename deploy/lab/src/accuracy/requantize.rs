//! A VDI stored in other bits: what those of color and whole steps of depth are worth.

use lamina_model::{Invalid, Supersegment, Vdi, VdiHeader};

/// Color and opacity rounded to `bits` each; opacity on the codec's scale, the square root of 1 - sqrt(T). Its gamma is 0, so
/// that the codec rounds no more than to 8.
///
/// # Errors
/// Never for bits of 1 to 24.
pub(super) fn with_color_bits(vdi: &Vdi, bits: u32) -> Result<Vdi, Invalid> {
    let most = f64::from(2_u32.pow(bits) - 1);
    let round = |x: f64| (most * x).round() / most;
    let rounded = |s: &Supersegment| {
        let color = s.color.map(|c| round(c.into()) as f32);
        let share = (-(-0.5 * f64::from(s.optical_depth)).exp_m1()).sqrt();
        // What is there stays there: the least opacity is one step, not none.
        let share = round(share).max(1.0 / most);
        Supersegment { color, optical_depth: (-2.0 * (-share * share).ln_1p()) as f32, ..*s }
    };
    let params = vdi.header().params.with_gamma(0.0)?;
    let header = VdiHeader { params, ..*vdi.header() };
    Vdi::new(header, vdi.offsets().to_vec(), vdi.segments().iter().map(rounded).collect())
}

/// Bits that the depths of `header`'s longest ray take.
pub(super) fn depth_bits(header: &VdiHeader) -> u32 {
    header.steps(header.bounds.size().length()).next_power_of_two().ilog2()
}

/// Depths counted in steps 2^n as long, so that they take `bits`.
///
/// What gets shorter than half a step joins what touches it behind; alone it keeps one step.
///
/// # Errors
/// If the steps are too long to be valid.
pub(super) fn with_depth_bits(vdi: &Vdi, bits: u32) -> Result<Vdi, Invalid> {
    let every = 2_u32.pow(depth_bits(vdi.header()).saturating_sub(bits));
    let header = VdiHeader { step_length: vdi.header().step_length * f64::from(every), ..*vdi.header() };
    let (mut offsets, mut segments) = (vec![0], Vec::with_capacity(vdi.segments().len()));
    let r = vdi.resolution();
    for (n, ends) in vdi.offsets().windows(2).enumerate() {
        let length = header.ray_span(n as u32 % r, n as u32 / r).map_or(0.0, |(t_in, t_out)| t_out - t_in);
        shorten(&vdi.segments()[ends[0] as usize..ends[1] as usize], every, header.steps(length), &mut segments);
        offsets.push(segments.len() as u32);
    }
    Vdi::new(header, offsets, segments)
}

/// One ray's list in steps `every` as long, of which the ray has `last`.
fn shorten(list: &[Supersegment], every: u32, last: u32, out: &mut Vec<Supersegment>) {
    let first = out.len();
    // Ends where it starts until something joins it.
    let mut waiting: Option<Supersegment> = None;
    for s in list {
        let [start, end] = [s.start, s.end].map(|depth| ((depth + every / 2) / every).min(last));
        let here = Supersegment { start, end, ..*s };
        let here = match waiting.take() {
            Some(w) if w.start == start => behind(&w, &here),
            Some(w) => {
                out.push(Supersegment { end: w.start + 1, ..w });
                here
            }
            None => here,
        };
        if here.end > here.start {
            out.push(here);
        } else {
            waiting = Some(here);
        }
    }
    match (waiting, out[first..].last_mut()) {
        (Some(w), _) if w.start < last => out.push(Supersegment { end: w.start + 1, ..w }),
        // At the ray's end there is no step behind it: it takes the last, or joins what has that.
        (Some(w), Some(before)) if before.end == last => *before = Supersegment { end: last, ..behind(before, &w) },
        (Some(w), _) if last > 0 => out.push(Supersegment { start: last - 1, end: last, ..w }),
        (Some(_) | None, _) => {}
    }
}

/// Two supersegments as one, `back` seen through `front`.
fn behind(front: &Supersegment, back: &Supersegment) -> Supersegment {
    let (a, through) = (front.opacity(), (-f64::from(front.optical_depth)).exp());
    let (near, far) = (a, through * back.opacity());
    let share = if near + far > 0.0 { near / (near + far) } else { 0.5 };
    let mix = |c: usize| (share * f64::from(front.color[c]) + (1.0 - share) * f64::from(back.color[c])) as f32;
    let optical_depth = front.optical_depth + back.optical_depth;
    Supersegment { start: front.start, end: back.end, color: std::array::from_fn(mix), optical_depth }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use lamina_model::{Aabb, Camera, VdiParams};

    fn vdi(segments: Vec<Supersegment>) -> Vdi {
        let header = VdiHeader {
            camera: Camera::new(DVec3::new(0.0, 0.0, 5.0), DVec3::ZERO, DVec3::Y, 30.0).unwrap(),
            bounds: Aabb::new(-DVec3::ONE, DVec3::ONE).unwrap(),
            step_length: 0.02,
            params: VdiParams::new(1, 0.0).unwrap(),
            transfer_id: 0,
            background: [0.0; 3],
        };
        Vdi::new(header, vec![0, segments.len() as u32], segments).unwrap()
    }

    fn segment(start: u32, end: u32) -> Supersegment {
        Supersegment { start, end, color: [0.5, 0.1, 1.0], optical_depth: 0.3 }
    }

    #[test]
    fn three_bits_are_sevenths_and_nothing_vanishes() {
        let thin = Supersegment { optical_depth: 1e-9, ..segment(1, 2) };
        let rounded = with_color_bits(&vdi(vec![segment(0, 1), thin]), 3).unwrap();
        assert_eq!(rounded.segments()[0].color, [4.0 / 7.0, 1.0 / 7.0, 1.0]);
        assert!(rounded.segments()[1].optical_depth > 0.0);
        let fine = with_color_bits(&vdi(vec![segment(0, 1)]), 16).unwrap();
        assert!((fine.segments()[0].optical_depth - 0.3).abs() < 1e-4);
    }

    #[test]
    fn depths_in_longer_steps_keep_place_and_opacity() {
        // 2 sqrt(3) / 0.02 is 174 steps: 8 bits. The ray itself runs through 100 of them, 25 in steps 4 as long.
        let whole =
            vdi(vec![segment(0, 8), segment(8, 9), segment(9, 10), segment(10, 14), segment(40, 41), segment(99, 100)]);
        assert_eq!(depth_bits(whole.header()), 8);
        assert_eq!(with_depth_bits(&whole, 8).unwrap(), whole);
        let coarse = with_depth_bits(&whole, 6).unwrap();
        let ends: Vec<(u32, u32)> = coarse.segments().iter().map(|s| (s.start, s.end)).collect();
        // 8 to 9 is less than half a step and joins 9 to 10; 99 to 100 has no step of its own left.
        assert_eq!(ends, [(0, 2), (2, 3), (3, 4), (10, 11), (24, 25)]);
        assert_eq!(coarse.header().step_length, 0.08);
        let sum = |vdi: &Vdi| vdi.segments().iter().map(|s| f64::from(s.optical_depth)).sum::<f64>();
        assert!((sum(&coarse) - sum(&whole)).abs() < 1e-6);
    }
}
