//! Messages to model types and back. Whatever arrives is checked by the model's own constructors.

use crate::{effects, required, v1};
use glam::DVec3;
use lamina_model::{
    Camera, ControlPoint, Grid, Invalid, ScalarRange, Scale, Scene, TransferFunction, VoxelType, camera::CameraFields,
};

impl From<DVec3> for v1::Vec3 {
    fn from(v: DVec3) -> Self {
        Self { x: v.x, y: v.y, z: v.z }
    }
}

impl From<v1::Vec3> for DVec3 {
    fn from(v: v1::Vec3) -> Self {
        Self::new(v.x, v.y, v.z)
    }
}

impl From<VoxelType> for v1::VoxelType {
    fn from(t: VoxelType) -> Self {
        match t {
            VoxelType::U8 => Self::U8,
            VoxelType::U16 => Self::U16,
            VoxelType::I16 => Self::I16,
            VoxelType::F16 => Self::F16,
            VoxelType::F32 => Self::F32,
            VoxelType::F64 => Self::F64,
        }
    }
}

impl TryFrom<v1::VoxelType> for VoxelType {
    type Error = Invalid;
    fn try_from(t: v1::VoxelType) -> Result<Self, Invalid> {
        match t {
            v1::VoxelType::Unspecified => Err(Invalid::new("voxel_type", "is missing or unknown to this version")),
            v1::VoxelType::U8 => Ok(Self::U8),
            v1::VoxelType::U16 => Ok(Self::U16),
            v1::VoxelType::I16 => Ok(Self::I16),
            v1::VoxelType::F16 => Ok(Self::F16),
            v1::VoxelType::F32 => Ok(Self::F32),
            v1::VoxelType::F64 => Ok(Self::F64),
        }
    }
}

impl From<&Grid> for v1::Grid {
    fn from(g: &Grid) -> Self {
        let [nx, ny, nz] = g.dims().map(|d| d as u64);
        Self { nx, ny, nz, spacing: Some(g.spacing().into()), origin: Some(g.origin().into()) }
    }
}

impl TryFrom<v1::Grid> for Grid {
    type Error = Invalid;
    fn try_from(g: v1::Grid) -> Result<Self, Invalid> {
        let side = |n: u64| usize::try_from(n).map_err(|_| Invalid::new("grid.dims", format!("{n} is too large")));
        let dims = [side(g.nx)?, side(g.ny)?, side(g.nz)?];
        Self::new(dims, required(g.spacing, "grid.spacing")?.into(), required(g.origin, "grid.origin")?.into())
    }
}

impl From<&Camera> for v1::Camera {
    fn from(c: &Camera) -> Self {
        let f = CameraFields::from(*c);
        Self {
            position: Some(f.position.into()),
            target: Some(f.target.into()),
            up: Some(f.up.into()),
            fov_y_deg: f.fov_y_deg,
        }
    }
}

impl TryFrom<v1::Camera> for Camera {
    type Error = Invalid;
    fn try_from(c: v1::Camera) -> Result<Self, Invalid> {
        Self::new(
            required(c.position, "camera.position")?.into(),
            required(c.target, "camera.target")?.into(),
            required(c.up, "camera.up")?.into(),
            c.fov_y_deg,
        )
    }
}

impl From<&TransferFunction> for v1::TransferFunction {
    fn from(t: &TransferFunction) -> Self {
        let point = |p: &ControlPoint| {
            let [red, green, blue] = p.color;
            v1::ControlPoint { at: p.at, red, green, blue, opacity: p.opacity }
        };
        Self {
            lo: t.range().lo(),
            hi: t.range().hi(),
            log10: t.range().scale() == Scale::Log10,
            unit_length: t.stated_unit_length(),
            points: t.points().iter().map(point).collect(),
        }
    }
}

impl TryFrom<v1::TransferFunction> for TransferFunction {
    type Error = Invalid;
    fn try_from(t: v1::TransferFunction) -> Result<Self, Invalid> {
        let scale = if t.log10 { Scale::Log10 } else { Scale::Linear };
        let point =
            |p: &v1::ControlPoint| ControlPoint { at: p.at, color: [p.red, p.green, p.blue], opacity: p.opacity };
        Self::new(ScalarRange::new(t.lo, t.hi, scale)?, t.unit_length, t.points.iter().map(point).collect())
    }
}

impl From<&Scene> for v1::Scene {
    fn from(s: &Scene) -> Self {
        let [background_red, background_green, background_blue] = s.background;
        Self {
            transfer: Some((&s.transfer).into()),
            camera: Some((&s.camera).into()),
            background_red,
            background_green,
            background_blue,
            step_voxels: s.step_voxels,
            effects: effects::of(s),
        }
    }
}

impl TryFrom<v1::Scene> for Scene {
    type Error = Invalid;
    fn try_from(s: v1::Scene) -> Result<Self, Invalid> {
        Self {
            transfer: required(s.transfer, "scene.transfer")?.try_into()?,
            camera: required(s.camera, "scene.camera")?.try_into()?,
            background: [s.background_red, s.background_green, s.background_blue],
            step_voxels: s.step_voxels,
            effects: s.effects.map(TryInto::try_into).transpose()?.unwrap_or_default(),
        }
        .check()
    }
}
