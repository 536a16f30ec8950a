//! Effects as messages, and back.

use crate::{required, v1};
use lamina_model::effects::{ClipBox, ClipPlane, ColorField, ColorPoint, DepthCue, Effects, Isosurface, Shading};
use lamina_model::{Invalid, ScalarRange, Scale, Scene};

impl From<&Effects> for v1::Effects {
    fn from(e: &Effects) -> Self {
        let shading = |s: Shading| {
            let Shading { ambient, diffuse, specular, shininess } = s;
            v1::Shading { ambient, diffuse, specular, shininess }
        };
        let surface = |s: &Isosurface| {
            let [red, green, blue] = s.color;
            v1::Isosurface { value: s.value, red, green, blue, opacity: Some(s.opacity) }
        };
        let plane = |p: &ClipPlane| v1::ClipPlane { normal: Some(p.normal.into()), offset: p.offset };
        let cue = |c: DepthCue| {
            let [red, green, blue] = c.color;
            v1::DepthCue { red, green, blue, strength: c.strength }
        };
        Self {
            light: e.light.map(Into::into),
            shading: e.shading.map(shading),
            shadows: e.shadows,
            ambient_occlusion: e.ambient_occlusion,
            isosurfaces: e.isosurfaces.iter().map(surface).collect(),
            clip_planes: e.clip_planes.iter().map(plane).collect(),
            clip_box: e.clip_box.map(|b| v1::ClipBox { min: Some(b.min.into()), max: Some(b.max.into()) }),
            pre_integrated: e.pre_integrated,
            depth_cue: e.depth_cue.map(cue),
            color_field: e.color_field.as_ref().map(Into::into),
        }
    }
}

impl From<&ColorField> for v1::ColorField {
    fn from(f: &ColorField) -> Self {
        let point = |p: &ColorPoint| {
            let [red, green, blue] = p.color;
            v1::ColorPoint { at: p.at, red, green, blue }
        };
        Self {
            name: f.name.clone(),
            lo: f.range.lo(),
            hi: f.range.hi(),
            log10: f.range.scale() == Scale::Log10,
            points: f.points.iter().map(point).collect(),
        }
    }
}

impl TryFrom<v1::ColorField> for ColorField {
    type Error = Invalid;
    fn try_from(f: v1::ColorField) -> Result<Self, Invalid> {
        let scale = if f.log10 { Scale::Log10 } else { Scale::Linear };
        let point = |p: v1::ColorPoint| ColorPoint { at: p.at, color: [p.red, p.green, p.blue] };
        Ok(Self {
            range: ScalarRange::new(f.lo, f.hi, scale)
                .map_err(|e| Invalid::new("effects.color_field.range", e.reason))?,
            points: f.points.into_iter().map(point).collect(),
            name: f.name,
        })
    }
}

/// Effects as they came; [`Scene::check`] tells whether they can be drawn.
impl TryFrom<v1::Effects> for Effects {
    type Error = Invalid;
    fn try_from(e: v1::Effects) -> Result<Self, Invalid> {
        let shading = |s: v1::Shading| {
            let v1::Shading { ambient, diffuse, specular, shininess } = s;
            Shading { ambient, diffuse, specular, shininess }
        };
        let surface = |s: &v1::Isosurface| Isosurface {
            value: s.value,
            color: [s.red, s.green, s.blue],
            opacity: s.opacity.unwrap_or(1.0),
        };
        let plane = |p: v1::ClipPlane| {
            Ok(ClipPlane { normal: required(p.normal, "effects.clip_planes.normal")?.into(), offset: p.offset })
        };
        let clip_box = |b: v1::ClipBox| {
            let (min, max) = (required(b.min, "effects.clip_box.min")?, required(b.max, "effects.clip_box.max")?);
            Ok::<_, Invalid>(ClipBox { min: min.into(), max: max.into() })
        };
        let cue = |c: v1::DepthCue| DepthCue { color: [c.red, c.green, c.blue], strength: c.strength };
        Ok(Self {
            light: e.light.map(Into::into),
            shading: e.shading.map(shading),
            shadows: e.shadows,
            ambient_occlusion: e.ambient_occlusion,
            isosurfaces: e.isosurfaces.iter().map(surface).collect(),
            clip_planes: e.clip_planes.into_iter().map(plane).collect::<Result<_, Invalid>>()?,
            clip_box: e.clip_box.map(clip_box).transpose()?,
            pre_integrated: e.pre_integrated,
            depth_cue: e.depth_cue.map(cue),
            color_field: e.color_field.map(TryInto::try_into).transpose()?,
        })
    }
}

/// The effects of a scene as a message; absent where it asks for none.
pub(crate) fn of(scene: &Scene) -> Option<v1::Effects> {
    (!scene.effects.is_none()).then(|| (&scene.effects).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn what_is_sent_arrives() {
        let all = Effects {
            light: Some(DVec3::new(1.0, 2.0, 3.0)),
            shading: Some(Shading { ambient: 0.1, diffuse: 0.2, specular: 0.3, shininess: 8 }),
            shadows: Some(0.5),
            ambient_occlusion: Some(0.25),
            isosurfaces: vec![Isosurface { value: 7.0, color: [0.1, 0.2, 0.3], opacity: 0.4 }],
            clip_planes: vec![ClipPlane { normal: DVec3::Y, offset: -2.0 }],
            clip_box: Some(ClipBox { min: DVec3::ZERO, max: DVec3::ONE }),
            pre_integrated: true,
            depth_cue: Some(DepthCue { color: [0.5, 0.6, 0.7], strength: 0.8 }),
            color_field: Some(ColorField {
                name: "temperature".into(),
                range: ScalarRange::new(3.0, 4e8, Scale::Log10).unwrap(),
                points: ColorField::cool_to_warm(),
            }),
        };
        for effects in [all, Effects::default()] {
            assert_eq!(Effects::try_from(v1::Effects::from(&effects)), Ok(effects));
        }
        let broken = v1::Effects { clip_planes: vec![v1::ClipPlane::default()], ..Default::default() };
        assert_eq!(Effects::try_from(broken).unwrap_err().thing, "effects.clip_planes.normal");
    }
}
