//! The HLLC approximate Riemann solver.
//!
//! Toro, *Riemann Solvers and Numerical Methods for Fluid Dynamics* (3rd ed., Springer 2009), chapter 10: the flux and
//! star states from section 10.4, wave speeds after Einfeldt from section 10.5, joined with the outer characteristics as
//! in Batten, Clarke, Lambert and Causon (SIAM J. Sci. Comput. 18, 1997), who show that density and pressure then stay
//! positive at first order. Einfeldt's form has no difference of large numbers, which single precision would not survive.

use crate::state::{LANES, LaneBlock, lane, least, most, set_lane};

/// The flux of the conserved quantities through faces with primitive states `left` and `right` on their two sides.
///
/// The velocity normal to the face is quantity 1; 2 and 3 are carried along.
#[inline]
pub(crate) fn hllc(left: &LaneBlock, right: &LaneBlock, gamma: f32, flux: &mut LaneBlock) {
    for l in 0..LANES {
        set_lane(flux, l, face_flux(lane(left, l), lane(right, l), gamma));
    }
}

/// Without branches: every choice is between two numbers that are computed anyway.
#[inline(always)]
fn face_flux(wl: [f32; 5], wr: [f32; 5], gamma: f32) -> [f32; 5] {
    let ([rho_l, u_l, _, _, p_l], [rho_r, u_r, _, _, p_r]) = (wl, wr);
    let (s_l, s_r) = wave_speeds(wl, wr, gamma);
    // Mass that the outer waves sweep up, as seen from each side: negative on the left, positive on the right.
    let (m_l, m_r) = (rho_l * (s_l - u_l), rho_r * (s_r - u_r));
    let s_star = (p_r - p_l + m_l * u_l - m_r * u_r) / (m_l - m_r);

    // The side K from which the contact moves away across the face.
    let is_left = s_star >= 0.0;
    let pick = |a: f32, b: f32| if is_left { a } else { b };
    let (rho, u, p) = (pick(rho_l, rho_r), pick(u_l, u_r), pick(p_l, p_r));
    let (v, w) = (pick(wl[2], wr[2]), pick(wl[3], wr[3]));
    let (s, m) = (pick(s_l, s_r), pick(m_l, m_r));
    let energy = p / (gamma - 1.0) + 0.5 * rho * (u * u + v * v + w * w);

    let rho_star = m / (s - s_star);
    let energy_star = rho_star * (energy / rho + (s_star - u) * (s_star + p / m));
    // F_K + S_K (U*_K - U_K) inside the fan; the bare F_K when even the outer wave is beyond the face.
    let fan = pick(least(s_l, 0.0), most(s_r, 0.0));
    let mass_flux = rho * u + fan * (rho_star - rho);
    [
        mass_flux,
        rho * u * u + p + fan * (rho_star * s_star - rho * u),
        // Density is the only thing that changes v and w's momenta across the outer wave.
        mass_flux * v,
        mass_flux * w,
        u * (energy + p) + fan * (energy_star - energy),
    ]
}

/// Bounds on the speeds of the outer waves.
#[inline(always)]
fn wave_speeds(wl: [f32; 5], wr: [f32; 5], gamma: f32) -> (f32, f32) {
    let ([rho_l, u_l, _, _, p_l], [rho_r, u_r, _, _, p_r]) = (wl, wr);
    let (a2_l, a2_r) = (gamma * p_l / rho_l, gamma * p_r / rho_r);
    let (root_l, root_r) = (rho_l.sqrt(), rho_r.sqrt());
    let per_roots = 1.0 / (root_l + root_r);
    let (share_l, share_r) = (root_l * per_roots, root_r * per_roots);
    let u_mean = share_l * u_l + share_r * u_r;
    let jump = u_r - u_l;
    let d = (share_l * a2_l + share_r * a2_r + 0.5 * share_l * share_r * jump * jump).sqrt();
    (least(u_l - a2_l.sqrt(), u_mean - d), most(u_r + a2_r.sqrt(), u_mean + d))
}
