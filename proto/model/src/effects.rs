//! What a scene may ask for beyond emission and absorption. What it does not ask for is not computed.

pub use crate::color_field::{ColorField, ColorPoint};
use crate::{Invalid, ScalarRange, Scale};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// The effects of a scene; none of them by default.
///
/// For each step of a ray, in this order: clipping cuts the step, the transfer function is applied to its middle or
/// integrated over it, a second field gives the color there, isosurfaces are met inside it, light is applied to both, then
/// the depth cue.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Effects {
    /// Towards the light, world coordinates, any length; shading and shadows need it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<DVec3>,
    /// Blinn-Phong shading by the gradient.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shading: Option<Shading>,
    /// How dark full shadow is: 0 not at all, 1 black.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shadows: Option<f64>,
    /// How dark a point is that nothing around lets light through to: 0 not at all, 1 black.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ambient_occlusion: Option<f64>,
    /// Surfaces of equal value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub isosurfaces: Vec<Isosurface>,
    /// Half spaces; only what lies in all of them is seen.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub clip_planes: Vec<ClipPlane>,
    /// A box; only what lies in it is seen.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip_box: Option<ClipBox>,
    /// Integrates the transfer function between a step's ends, where the scalar is taken as linear, instead of taking it in
    /// the middle: thin features do not fall between samples (Engel, Kraus and Ertl 2001).
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub pre_integrated: bool,
    /// Colors fade with distance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_cue: Option<DepthCue>,
    /// Colors come from a second field.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_field: Option<ColorField>,
}

/// Light from one direction: color x (ambient + diffuse |n.l|) + specular |n.h|^shininess, both sides alike; h halves the
/// angle between light and eye. n is the gradient's direction; the weaker the gradient, the less of it applies (a hundredth
/// of the range a voxel: half).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Shading {
    /// Light from everywhere.
    pub ambient: f64,
    /// Light scattered to all sides.
    pub diffuse: f64,
    /// Highlight.
    pub specular: f64,
    /// Its sharpness: a power of two from 1 to 256.
    pub shininess: u32,
}

impl Default for Shading {
    fn default() -> Self {
        Self { ambient: 0.4, diffuse: 0.6, specular: 0.2, shininess: 32 }
    }
}

/// Where the field has one value; taken where a ray's step crosses it, at the place that two secants find.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Isosurface {
    /// The value, data units.
    pub value: f64,
    /// Red, green, blue, each 0..1.
    pub color: [f64; 3],
    /// 0..1.
    #[serde(default = "opaque")]
    pub opacity: f64,
}

fn opaque() -> f64 {
    1.0
}

/// The half space where `normal` . x <= `offset`, world coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipPlane {
    /// Away from what is kept; any length.
    pub normal: DVec3,
    /// In units of that length.
    pub offset: f64,
}

/// Two corners, world coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipBox {
    /// Lower corner.
    pub min: DVec3,
    /// Upper corner.
    pub max: DVec3,
}

/// From the box's nearest point (the eye, if it is inside) to its farthest corner, colors go over to another one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthCue {
    /// Red, green, blue, each 0..1.
    pub color: [f64; 3],
    /// How far at the far end: 1 all the way.
    pub strength: f64,
}

impl Effects {
    /// The most isosurfaces of a scene.
    pub const MOST_ISOSURFACES: usize = 4;
    /// The most clip planes of a scene, beside a box.
    pub const MOST_PLANES: usize = 8;

    /// True if the scene asks for nothing.
    pub fn is_none(&self) -> bool {
        *self == Self { light: self.light, ..Self::default() }
    }

    /// What there is, for people to read: `shading, shadows 0.5, isosurfaces 2`.
    pub(crate) fn listed(&self) -> String {
        let share = |name: &str, share: Option<f64>| share.map(|share| format!("{name} {share}"));
        let count = |name: &str, count: usize| (count > 0).then(|| format!("{name} {count}"));
        let listed = [
            self.shading.map(|_| "shading".to_owned()),
            share("shadows", self.shadows),
            share("ambient occlusion", self.ambient_occlusion),
            count("isosurfaces", self.isosurfaces.len()),
            count("clip planes", self.clip_planes.len()),
            self.clip_box.map(|_| "clip box".to_owned()),
            self.pre_integrated.then(|| "pre-integrated".to_owned()),
            share("depth cue", self.depth_cue.map(|cue| cue.strength)),
            self.color_field.as_ref().map(|field| format!("colors of {}", field.name)),
        ];
        let listed: Vec<String> = listed.into_iter().flatten().collect();
        if listed.is_empty() { "none".to_owned() } else { listed.join(", ") }
    }

    /// These without those that are of one field's values.
    #[must_use]
    pub fn of_any_field(self) -> Self {
        Self { isosurfaces: Vec::new(), color_field: None, ..self }
    }

    /// True if light is to be followed through the whole field: there are shadows or ambient occlusion.
    pub fn needs_light_volume(&self) -> bool {
        self.shadows.unwrap_or(0.0) > 0.0 || self.ambient_occlusion.unwrap_or(0.0) > 0.0
    }

    /// These and those of `other`; where both have one, the first.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        Self {
            light: self.light.or(other.light),
            shading: self.shading.or(other.shading),
            shadows: self.shadows.or(other.shadows),
            ambient_occlusion: self.ambient_occlusion.or(other.ambient_occlusion),
            isosurfaces: [&self.isosurfaces[..], &other.isosurfaces].concat(),
            clip_planes: [&self.clip_planes[..], &other.clip_planes].concat(),
            clip_box: self.clip_box.or(other.clip_box),
            pre_integrated: self.pre_integrated || other.pre_integrated,
            depth_cue: self.depth_cue.or(other.depth_cue),
            color_field: self.color_field.clone().or_else(|| other.color_field.clone()),
        }
    }

    /// Passes effects that can be drawn.
    ///
    /// # Errors
    /// If a number is out of bounds, or shading or shadows have no light.
    pub fn check(&self, range: &ScalarRange) -> Result<(), Invalid> {
        let share = |thing: &'static str, x: f64| {
            let ok = (0.0..=1.0).contains(&x);
            if ok { Ok(()) } else { Err(Invalid::new(thing, format!("{x} must lie in 0..1"))) }
        };
        let lit = self.shading.is_some() || self.shadows.is_some();
        match self.light {
            Some(l) if !(l.is_finite() && l.abs().max_element() > 0.0) => {
                return Err(Invalid::new("effects.light", format!("{l} must be a direction: finite and not zero")));
            }
            None if lit => {
                return Err(Invalid::new("effects.light", "shading and shadows need the direction towards the light"));
            }
            _ => {}
        }
        if let Some(s) = self.shading {
            share("effects.shading.ambient", s.ambient)?;
            share("effects.shading.diffuse", s.diffuse)?;
            share("effects.shading.specular", s.specular)?;
            if !(s.shininess.is_power_of_two() && s.shininess <= 256) {
                let n = s.shininess;
                return Err(Invalid::new("effects.shading.shininess", format!("{n} must be a power of two up to 256")));
            }
        }
        share("effects.shadows", self.shadows.unwrap_or(0.0))?;
        share("effects.ambient_occlusion", self.ambient_occlusion.unwrap_or(0.0))?;
        if self.isosurfaces.len() > Self::MOST_ISOSURFACES {
            let (n, most) = (self.isosurfaces.len(), Self::MOST_ISOSURFACES);
            return Err(Invalid::new("effects.isosurfaces", format!("{n} given; at most {most}")));
        }
        for s in &self.isosurfaces {
            s.color.iter().chain([&s.opacity]).try_for_each(|x| share("effects.isosurfaces", *x))?;
            // A logarithm that cannot be taken, or is cut off, is where all such values are.
            let lost = range.scale() == Scale::Log10 && range.unit_from_value(s.value) <= -1.0;
            if lost || !range.unit_from_value(s.value).is_finite() {
                let value = s.value;
                return Err(Invalid::new("effects.isosurfaces", format!("value {value} cannot lie in this range")));
            }
        }
        if self.clip_planes.len() > Self::MOST_PLANES {
            let (n, most) = (self.clip_planes.len(), Self::MOST_PLANES);
            return Err(Invalid::new("effects.clip_planes", format!("{n} given; at most {most}")));
        }
        for p in &self.clip_planes {
            if !(p.normal.is_finite() && p.normal.abs().max_element() > 0.0 && p.offset.is_finite()) {
                return Err(Invalid::new("effects.clip_planes", format!("{p:?} must be finite, the normal not zero")));
            }
        }
        if let Some(b) = self.clip_box.filter(|b| !(b.min.is_finite() && b.max.is_finite() && b.min.cmplt(b.max).all()))
        {
            let (min, max) = (b.min, b.max);
            return Err(Invalid::new("effects.clip_box", format!("{min} to {max}: the lower corner comes first")));
        }
        if let Some([a, b]) = self.nothing_between() {
            let reason =
                format!("{a:?} and {b:?} (a box has six such) leave nothing between them; turn one round, or move it");
            return Err(Invalid::new("effects.clip_planes", reason));
        }
        if let Some(cue) = self.depth_cue {
            cue.color.iter().chain([&cue.strength]).try_for_each(|x| share("effects.depth_cue", *x))?;
        }
        self.color_field.as_ref().map_or(Ok(()), ColorField::check)
    }

    /// True if samples are taken beside the middle of a step: at its ends, or in the middle of what clipping leaves.
    pub fn look_beside(&self) -> bool {
        self.pre_integrated || !self.isosurfaces.is_empty() || !self.half_spaces().is_empty()
    }

    /// Passes a sampling step that these effects can be drawn with, voxels.
    ///
    /// # Errors
    /// If it is above 8 and they look beside the middle of a step.
    pub fn check_step(&self, step_voxels: f64) -> Result<(), Invalid> {
        if self.look_beside() && step_voxels > 8.0 {
            let why = "isosurfaces, clipping and pre_integrated need 8 voxels or less";
            return Err(Invalid::new("step_voxels", format!("{step_voxels}: {why}")));
        }
        Ok(())
    }

    /// Two half spaces, if any, that face away from each other and have no point in common.
    fn nothing_between(&self) -> Option<[ClipPlane; 2]> {
        let all = self.half_spaces();
        let apart = |a: &ClipPlane, b: &ClipPlane| {
            let opposite = a.normal.cross(b.normal) == DVec3::ZERO && a.normal.dot(b.normal) < 0.0;
            opposite && a.offset / a.normal.length() < -b.offset / b.normal.length()
        };
        all.iter().enumerate().find_map(|(n, a)| all[..n].iter().find(|b| apart(a, b)).map(|b| [*a, *b]))
    }

    /// All half spaces, those of the box among them.
    pub fn half_spaces(&self) -> Vec<ClipPlane> {
        let sides = self.clip_box.iter().flat_map(|b| {
            [DVec3::X, DVec3::Y, DVec3::Z].into_iter().flat_map(|axis| {
                [
                    ClipPlane { normal: axis, offset: axis.dot(b.max) },
                    ClipPlane { normal: -axis, offset: -axis.dot(b.min) },
                ]
            })
        });
        self.clip_planes.iter().copied().chain(sides).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range() -> ScalarRange {
        ScalarRange::new(1.0, 10.0, Scale::Log10).unwrap()
    }

    fn refused(text: &str) -> String {
        match serde_json::from_str::<Effects>(text) {
            Ok(effects) => effects.check(&range()).unwrap_err().to_string(),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn unknown_and_contradictory_effects_are_refused_by_name() {
        assert!(refused(r#"{"fog": 1}"#).contains("fog"));
        assert!(refused(r#"{"shading": {}}"#).contains("effects.light"));
        assert!(refused(r#"{"shadows": 0.5}"#).contains("effects.light"));
        assert!(refused(r#"{"light": [0, 0, 0]}"#).contains("effects.light"));
        assert!(refused(r#"{"light": [0, 0, 1], "shadows": 2}"#).contains("effects.shadows"));
        assert!(refused(r#"{"light": [0, 0, 1], "shading": {"shininess": 5}}"#).contains("shininess"));
        assert!(refused(r#"{"isosurfaces": [{"value": 3, "color": [0, 0, 2]}]}"#).contains("isosurfaces"));
        let planes = |low: f64| {
            let plane = |x: i32, offset: f64| format!(r#"{{"normal": [{x}, 0, 0], "offset": {offset}}}"#);
            format!(r#"{{"clip_planes": [{}, {}]}}"#, plane(2, 6.0), plane(-1, -low))
        };
        assert!(refused(&planes(4.0)).contains("leave nothing"), "x up to 3 and from 4 on");
        serde_json::from_str::<Effects>(&planes(2.0)).unwrap().check(&range()).unwrap();
        assert!(refused(r#"{"isosurfaces": [{"value": -3, "color": [0, 0, 1]}]}"#).contains("value -3"));
        assert!(refused(r#"{"clip_box": {"min": [0, 0, 0], "max": [1, 0, 1]}}"#).contains("clip_box"));
        assert!(refused(r#"{"clip_planes": [{"normal": [0, 0, 0], "offset": 1}]}"#).contains("clip_planes"));
    }

    #[test]
    fn a_light_alone_is_no_effect() {
        assert!(Effects { light: Some(DVec3::X), ..Effects::default() }.is_none());
        assert!(!Effects { pre_integrated: true, ..Effects::default() }.is_none());
    }
}
