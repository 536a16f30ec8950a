//! `accuracy.csv`: every point of every curve, and the trials in which several knobs were turned at once.

use super::Findings;
use super::curve::{Convergence, Parameter, Point, Price};
use crate::table::Table;
use std::path::Path;

const COLUMNS: &str = "knob,value,source,pre_integrated,step_voxels,opacity_cutoff,gamma,resolution,psnr_db,rms_error,max_error,\
    alone_db,time_ms,encode_ms,draw_ms,size_bytes,ms_per_db,kb_per_db,order,level_from";

/// Writes it.
pub(super) fn write(folder: &Path, findings: &Findings) -> anyhow::Result<()> {
    let mut table = Table::create(folder, "accuracy.csv", COLUMNS.split(','))?;
    for curve in &findings.curves {
        let convergence = findings.convergence(curve);
        for (point, price) in curve.points.iter().zip(curve.prices()) {
            table.row(row(Some(&curve.knob), point, price, convergence))?;
        }
    }
    for point in &findings.trials {
        table.row(row(None, point, Price::default(), Convergence::default()))?;
    }
    table.finish()
}

fn row(knob: Option<&Parameter>, p: &Point, price: Price, convergence: Convergence) -> [String; 20] {
    let number = |value: Option<f64>| value.filter(|v| v.is_finite()).map_or_else(String::new, |v| format!("{v:.6}"));
    let of = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
    [
        knob.map_or("combined", |k| k.key).to_owned(),
        knob.map_or_else(String::new, |_| p.value.to_string()),
        knob.map_or("vdi", |k| k.source.name()).to_owned(),
        p.pre_integrated.to_string(),
        of(p.params.map(|p| p.step_voxels())),
        of(p.params.map(|p| p.opacity_cutoff())),
        of(p.params.map(|p| p.gamma())),
        p.params.map_or_else(String::new, |p| p.resolution().to_string()),
        format!("{:.4}", p.decibels()),
        format!("{:e}", p.error.rms),
        format!("{:e}", p.error.max),
        p.alone.map_or_else(String::new, |e| format!("{:.4}", e.decibels())),
        number(Some(p.time_ms)),
        number(p.encode_ms),
        number(p.draw_ms),
        p.size_bytes.map_or_else(String::new, |b| b.to_string()),
        number(price.ms_per_db),
        number(price.kb_per_db),
        number(convergence.order),
        of(convergence.level_from),
    ]
}
